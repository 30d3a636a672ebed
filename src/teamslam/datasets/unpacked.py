"""Downloads unpacked: zip and tar archives, and single files that are compressed.

What comes out is a folder of plain files: links become copies of what they lead to, and files that are compressed
within the archive by themselves (`.bz2`, `.gz`, `.xz`) are undone. Nothing is written outside the folder, and there is
no folder until all of it is there.
"""

import bz2
import gzip
import lzma
import os
import posixpath
import shutil
import tarfile
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from teamslam.errors import InputError
from teamslam.io.files.whole import beside

COMPRESSED: dict[str, Callable[[IO[bytes]], Any]] = {
    ".bz2": bz2.BZ2File,
    ".gz": lambda file: gzip.GzipFile(fileobj=file),
    ".xz": lzma.LZMAFile,
}
DAMAGE = (tarfile.TarError, zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, gzip.BadGzipFile)
MANY = 100_000  # files: more than any of the sets has by far
Member = tuple[str, Callable[[], IO[bytes]]]


def unpack(path: Path, folder: Path) -> list[Path]:
    """The files of a download, unpacked into a new folder; their paths within it, sorted.

    Raises InputError where the folder is there already, and for what is no archive, is damaged or cut off, or would
    write outside the folder.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError("the output is there already; choose another name", path=folder)
    draft = beside(folder.absolute())
    try:
        with members(path) as found:
            for name, opened in found:
                _write(draft, name, opened, path)
        if not draft.is_dir():
            raise InputError("this archive is empty; download it once more", path=path)
        if folder.exists():
            folder.rmdir()
        os.replace(draft, folder)
    except NotImplementedError as error:
        raise InputError(f"this archive cannot be unpacked here ({error}); unpack it by hand", path=path) from None
    except DAMAGE as error:
        raise InputError(
            f"the archive is damaged or cut off ({error or 'it ends too early'}); download it once more", path=path
        ) from None
    finally:
        shutil.rmtree(draft, ignore_errors=True)
    return sorted(found.relative_to(folder) for found in folder.rglob("*") if found.is_file())


@contextmanager
def members(path: Path) -> Iterator[Iterator[Member]]:
    """The files in an archive: their names, and how to open each."""
    if path.is_dir():
        raise InputError("this is a folder, unpacked already; look into it with: teamslam info FOLDER", path=path)
    try:
        if path.stat().st_size == 0:
            raise EOFError("it is empty")
        if zipfile.is_zipfile(path):
            with zipfile.ZipFile(path) as archive:
                yield _of_zip(archive, path)
        elif tarfile.is_tarfile(path):
            with tarfile.open(path) as tar:
                yield _of_tar(tar, path)
        elif path.suffix == ".zip":
            raise zipfile.BadZipFile("it ends too early, or is no zip")
        elif path.suffix in COMPRESSED:
            yield iter([(path.name, lambda: path.open("rb"))])
        else:
            raise InputError(
                "this is no archive that can be unpacked: zip, tar (also .gz, .bz2, .xz), or a single file .gz, .bz2, "
                ".xz; of an archive in another form, unpack it and run: teamslam info FOLDER",
                path=path,
            )
    except OSError as error:
        if isinstance(error, DAMAGE):
            raise
        raise InputError(f"cannot be read: {error.strerror or error}", path=path) from None


def _of_zip(archive: zipfile.ZipFile, path: Path) -> Iterator[Member]:
    files = [member for member in archive.infolist() if not member.is_dir()]
    _refuse_many(len(files), path)
    for member in files:
        if member.flag_bits & 1:
            raise InputError("the archive asks for a password; unpack it by hand", path=path)
        yield member.filename, lambda member=member: archive.open(member)  # type: ignore[misc]


def _of_tar(tar: tarfile.TarFile, path: Path) -> Iterator[Member]:
    """Links stand for what they lead to in the archive; what leads elsewhere, and devices, are refused."""
    entries = {posixpath.normpath(member.name): member for member in tar.getmembers()}
    _refuse_many(len(entries), path)
    for name, member in entries.items():
        if member.isdir():
            continue
        target, steps = member, 0
        while (target.issym() or target.islnk()) and steps < 10:
            base = posixpath.dirname(target.name) if target.issym() else ""
            place = posixpath.normpath(posixpath.join(base, target.linkname))
            if place not in entries:
                raise InputError(f"'{name}' is a link to '{member.linkname}', which the archive lacks", path=path)
            target, steps = entries[place], steps + 1
        if not target.isfile():
            raise InputError(f"'{name}' is neither a file nor a folder; unpack it by hand", path=path)
        yield name, lambda target=target: _opened(tar, target)  # type: ignore[misc]


def _opened(tar: tarfile.TarFile, member: tarfile.TarInfo) -> IO[bytes]:
    file = tar.extractfile(member)
    assert file is not None  # a regular file
    return file


def _refuse_many(count: int, path: Path) -> None:
    if count > MANY:
        raise InputError(f"the archive holds {count:,} files, more than any data set that teamslam reads", path=path)


def _write(draft: Path, name: str, opened: Callable[[], IO[bytes]], path: Path) -> None:
    """One file into the draft, undone where it is compressed by itself."""
    parts = name.replace("\\", "/").split("/")
    if name.startswith(("/", "\\")) or ".." in parts or ":" in parts[0]:
        raise InputError(f"the archive would write outside the folder, to '{name}': it is not unpacked", path=path)
    target = draft.joinpath(*[part for part in parts if part not in ("", ".")])
    undo = COMPRESSED.get(target.suffix)
    if undo is not None:
        target = target.with_suffix("")
    target.parent.mkdir(parents=True, exist_ok=True)
    with opened() as packed, target.open("xb") as plain:
        shutil.copyfileobj(undo(packed) if undo is not None else packed, plain)
