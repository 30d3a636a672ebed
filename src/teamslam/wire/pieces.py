"""Pieces of a log as files `*.piece`: raw messages to the bit, so that each can be built elsewhere and still be known
for what it is: which rows of whose log."""

from collections.abc import Iterable, Sequence
from pathlib import Path

from teamslam.errors import InputError
from teamslam.io.files.whole import whole_file
from teamslam.model import Dataset, index_of
from teamslam.wire.messages import Received, receive, send_raw

SUFFIX = ".piece"


def write_pieces(pieces: Sequence[Dataset], folder: Path, *, version: int = 0) -> list[Path]:
    """One file a piece, numbered in order; `version` is that of the submaps that will be built of them."""
    width, files = len(str(len(pieces))), []
    for number, piece in enumerate(pieces, 1):
        robot = piece.tables[0].robot
        id_ = f"{piece.names.robot(robot)}/{int(index_of(piece.pose_keys[robot][0]))}"  # as `build` calls it
        files.append(folder / f"{number:0{width}}_robot_{robot}{SUFFIX}")
        with whole_file(files[-1]) as file:
            file.write(send_raw(piece, id_, version).data)
    return files


def piece_files(paths: Iterable[Path]) -> list[Path]:
    """The piece files among paths: files by their ending, and all those in folders."""
    found: list[Path] = []
    for path in paths:
        found += sorted(path.glob(f"*{SUFFIX}")) if path.is_dir() else [path] if path.suffix == SUFFIX else []
    return found


def read_piece(path: Path) -> Received:
    """The piece in a file; `.submap()` builds it. InputError says what is wrong with the file."""
    try:
        received = receive(path.read_bytes())
    except OSError as error:
        raise InputError(f"the file cannot be read: {error.strerror or error}", path=path) from None
    except InputError as error:
        raise InputError(error.problem, path=path) from None
    if received.kind != "raw":
        raise InputError("this holds a submap, not a piece of a log; `teamslam join` takes submaps", path=path)
    return received
