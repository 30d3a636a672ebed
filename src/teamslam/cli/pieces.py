"""Pieces from whatever the user points at: a log that is cut here, or pieces that were cut before."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from teamslam.model import Dataset


def pieces_of(
    log: Path, *, format: str | None = None, poses_per_piece: int | None = None, keyframe: int | None = None
) -> "list[Dataset]":
    """The pieces of a log. InputError where it cannot be read."""
    from teamslam.config import SplitOptions
    from teamslam.errors import InputError
    from teamslam.frontend.thin import keyframe as thin
    from teamslam.io import read
    from teamslam.joining import split

    options = SplitOptions(poses_per_piece)
    dataset = read(log, format=format)
    if keyframe is not None:
        dataset = thin(dataset, every=keyframe)
    pieces = split(dataset, poses_per_piece=options.poses_per_piece, heading_sigma=options.heading_sigma)
    if not pieces:
        raise InputError("this log holds no measurement; there is nothing to cut into pieces", path=log)
    return pieces


def pieces_in(
    paths: Sequence[Path], format: str | None, poses_per_piece: int | None
) -> "tuple[list[Dataset], list[str]]":
    """The pieces in files and folders of pieces, with what is wrong with those that are damaged; else of the one log
    that is named. InputError where there is nothing to build."""
    from teamslam.errors import InputError
    from teamslam.io.submaps.arrays import sniff
    from teamslam.model import Dataset
    from teamslam.wire.pieces import piece_files, read_piece

    if files := list(dict.fromkeys(piece_files(paths))):
        for path in paths:
            if not piece_files([path]):
                raise InputError("this holds no piece, unlike the others; build one kind of input at a time", path=path)
        if format is not None or poses_per_piece is not None:
            raise InputError(
                "these are pieces, cut before: --format and --poses-per-piece are for a log", path=paths[0]
            )
        contents, damaged = [], []
        for file in files:
            try:
                contents.append(read_piece(file).content)
            except InputError as error:
                damaged.append(str(error))
        return [content for content in contents if isinstance(content, Dataset)], damaged
    for path in paths:
        if path.exists() and sniff(path):
            raise InputError("these are submaps, already built; join them: `teamslam join`", path=path)
    if len(paths) != 1:
        raise InputError("give one log, or files or folders of pieces as `teamslam split` writes them")
    return pieces_of(paths[0], format=format, poses_per_piece=poses_per_piece), []
