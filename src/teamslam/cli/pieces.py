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
    from teamslam.io import read
    from teamslam.joining import split
    from teamslam.joining.keyframes import keyframe as thin

    options = SplitOptions(poses_per_piece)
    dataset = read(log, format=format)
    if keyframe is not None:
        dataset = thin(dataset, every=keyframe)
    return split(dataset, poses_per_piece=options.poses_per_piece, heading_sigma=options.heading_sigma)


def pieces_in(paths: Sequence[Path], format: str | None, poses_per_piece: int | None) -> "list[Dataset]":
    """The pieces in files and folders of pieces; else of the one log that is named."""
    from teamslam.errors import InputError
    from teamslam.model import Dataset
    from teamslam.net.pieces import piece_files, read_piece

    files = piece_files(paths)
    if files:
        contents = [read_piece(file).content for file in files]
        return [content for content in contents if isinstance(content, Dataset)]
    if len(paths) != 1:
        raise InputError("give one log, or files or folders of pieces as `teamslam split` writes them")
    return pieces_of(paths[0], format=format, poses_per_piece=poses_per_piece)
