"""Which public data sets a folder holds, and whether their files are those that were measured with."""

import hashlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

from teamslam.datasets.catalogue import PublicSet, public_sets
from teamslam.io import formats_of

DEEPEST = 4  # folders below the one that was unpacked


@dataclass(frozen=True)
class Found:
    """A data set in a folder: which of its files are as known here, which are others, which are not there."""

    known: PublicSet
    folder: Path
    same: tuple[str, ...]
    differ: tuple[str, ...]
    missing: tuple[str, ...]

    @property
    def is_called_so(self) -> bool:
        """Whether the folder, or the set's one file, has the name that it has where it is published."""
        return self.folder.name == self.known.folder or (self.folder / (self.known.file or "/")).is_file()

    def is_rather(self, other: "Found") -> bool:
        """Whether the same files are better taken for those of another set."""
        shared = {*self.same, *self.differ} & {*other.same, *other.differ}
        return bool(shared) and self.folder == other.folder and len(self.same) < len(other.same)


def found_in(folder: Path) -> list[Found]:
    """The public sets whose files, or whose folder where no checksums are known, lie in a folder.

    A set is there where one file at least is the same to the bit, or where its folder or its one file has its name; of
    sets whose files are called alike that of which most are the same.
    """
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    digests = Digests()
    every = [_compared(known, root, digests) for known in public_sets() for root in _roots(known, folder, files)]
    there = [found for found in every if found.same or found.is_called_so]
    return [found for found in there if not any(found.is_rather(other) for other in there)]


def readable_in(folder: Path) -> Path | None:
    """What teamslam reads in a folder: itself, or the nearest file or folder below; None where there is nothing."""
    level = [folder]
    for _ in range(DEEPEST):
        for path in level:
            if formats_of(path):
                return path
        level = [below for path in level if path.is_dir() for below in sorted(path.iterdir())]
    return None


class Digests(dict[Path, str]):
    """SHA-256 of files, each read once."""

    def __missing__(self, path: Path) -> str:
        with path.open("rb") as file:
            self[path] = hashlib.file_digest(file, "sha256").hexdigest()
        return self[path]

    def together(self, paths: Iterable[Path]) -> str:
        """The digest of what `LC_ALL=C sha256sum NAMES` prints for some files of a folder."""
        lines = "".join(f"{self[path]}  {path.name}\n" for path in sorted(paths, key=lambda path: path.name))
        return hashlib.sha256(lines.encode()).hexdigest()


def _roots(known: PublicSet, folder: Path, files: list[Path]) -> Iterator[Path]:
    """The folders in which a set's files might lie: by a file's place, or by the folder's name."""
    if not known.sha256:
        yield from (path for path in [folder, *folder.rglob("*")] if path.is_dir() and path.name == known.folder)
        return
    depth = {name: name.count("/") for name in known.sha256}
    roots = {
        path.parents[depth[name]]
        for name in known.sha256
        for path in files
        if fnmatchcase(path.name, Path(name).name) and fnmatchcase(path.as_posix(), f"*/{name}")
    }
    yield from sorted(roots)


def _compared(known: PublicSet, root: Path, digests: Digests) -> Found:
    """The files of a set as they lie in a folder."""
    same, differ, missing = [], [], []
    for name, digest in known.sha256.items():
        paths = list(root.glob(name))
        if not paths:
            missing.append(name)
        elif digest == (digests.together(paths) if "*" in name else digests[paths[0]]):
            same.append(name)
        else:
            differ.append(name)
    return Found(known, root, tuple(same), tuple(differ), tuple(missing))
