"""A file that grows by whole lines, on a disk that may be full or read-only.

What cannot be written waits in memory and is tried again with the next line. A torn line, left by a process that was
killed, is cut when the file is opened.
"""

from pathlib import Path

MOST = 64 << 20  # bytes that wait at most
TAIL = 1 << 16  # longer than any line


class Growing:
    """A text file that lines are added to. `trouble`: what is wrong with the disk now, in words; `lost` counts lines
    that could not even wait."""

    def __init__(self, path: Path) -> None:
        self.path, self.trouble, self.lost = path, "", 0
        self._waiting = bytearray()
        if path.is_file():
            _cut(path)
        self._file = path.open("ab", buffering=0)

    def add(self, line: str) -> None:
        """One line more, with its end."""
        data = line.encode()
        if len(self._waiting) + len(data) > MOST:
            self.lost += 1
        else:
            self._waiting += data
        self._write()

    def close(self) -> None:
        """No more will be added."""
        self._write()
        self._file.close()

    def _write(self) -> None:
        try:
            while self._waiting:
                del self._waiting[: self._file.write(self._waiting) or 0]
            self.trouble = ""
        except OSError as error:
            self.trouble = f"{self.path}: {error.strerror or error}; {len(self._waiting)} bytes wait in memory"


def _cut(path: Path) -> None:
    """Without what follows the last whole line."""
    size = path.stat().st_size
    with path.open("r+b") as file:
        file.seek(max(0, size - TAIL))
        tail = file.read()
        file.truncate(size - len(tail) + tail.rfind(b"\n") + 1)
