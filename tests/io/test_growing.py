"""A file that grows by lines loses none to a disk that fills, and begins after a whole one."""

import subprocess
import sys
from pathlib import Path

from teamslam.io.files.growing import Growing

FILLS = """
import resource, signal, sys
from pathlib import Path
from teamslam.io.files.growing import Growing
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
most = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, most))
file = Growing(Path(sys.argv[1]))
said = []
for n in range(300):
    file.add(f"line {n}\\n")
    said.append(file.trouble)
assert not said[0] and "File too large" in said[-1] and "bytes wait" in said[-1], said
assert Path(sys.argv[1]).stat().st_size == 1000
resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))
file.add("last\\n")
assert not file.trouble and not file.lost
file.close()
"""


def test_what_a_full_disk_does_not_take_comes_once_there_is_room(tmp_path: Path) -> None:
    subprocess.run([sys.executable, "-c", FILLS, str(tmp_path / "lines")], check=True)
    assert (tmp_path / "lines").read_text().splitlines() == [*(f"line {n}" for n in range(300)), "last"]


def test_a_torn_line_is_cut(tmp_path: Path) -> None:
    for whole, torn in (("a\nb\n", "c,d"), ("", "head"), ("", ""), ("x" * 200_000 + "\n", "y")):
        (tmp_path / "lines").write_text(whole + torn)
        file = Growing(tmp_path / "lines")
        file.add("next\n")
        file.close()
        assert (tmp_path / "lines").read_text() == whole + "next\n"
