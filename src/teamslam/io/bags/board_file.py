"""A calibration board from a file: TOML, or the target that Kalibr takes (YAML).

[board]
kind = "charuco"          or "aprilgrid"
columns = 8               squares of a chessboard, tags of a grid
rows = 6
square_m = 0.04           of the chessboard, and
marker_m = 0.03           of the markers in it
dictionary = "4X4_50"
tag_m = 0.088             of a grid: the edge of a tag,
spacing = 0.3             and the gap between two, in edges
family = "tag36h11"
"""

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from teamslam.errors import InputError
from teamslam.frontend.boards import AprilGrid, Board, Charuco
from teamslam.io.bags.calibration import parsed
from teamslam.io.files.toml import converted, read_toml
from teamslam.io.files.whole import whole_file

KINDS: dict[str, type[Charuco] | type[AprilGrid]] = {"charuco": Charuco, "aprilgrid": AprilGrid}
KALIBR = {"tagCols": "columns", "tagRows": "rows", "tagSize": "tag_m", "tagSpacing": "spacing"}


def read_board(path: Path) -> Board:
    """The board in a file. InputError names the field that is wrong."""
    if path.suffix.lower() in (".yaml", ".yml"):
        target = parsed(path)
        if target.get("target_type") != "aprilgrid":
            raise InputError(
                f"a target of Kalibr that can be used is an aprilgrid, found '{target.get('target_type')}'", path=path
            )
        return _board(AprilGrid, {ours: target[theirs] for theirs, ours in KALIBR.items() if theirs in target}, path)
    table = read_toml(path).get("board")
    if not isinstance(table, Mapping):
        raise InputError("no [board] in it", path=path, field="board")
    given = dict(table)
    kind = given.pop("kind", None)
    if kind not in KINDS:
        raise InputError(f"kind is one of {', '.join(KINDS)}, found {kind!r}", path=path, field="board.kind")
    return _board(KINDS[kind], given, path)


def write_board(board: Board, path: Path) -> None:
    """A board as TOML. Law: read_board gives the same."""
    import tomli_w

    kind = next(name for name, type in KINDS.items() if isinstance(board, type))
    with whole_file(path) as file:
        tomli_w.dump({"board": {"kind": kind} | vars(board)}, file)


def _board(type: Any, given: Mapping[str, Any], path: Path) -> Board:
    known = [field.name for field in fields(type)]
    for name in given:
        if name not in known:
            raise InputError(f"unknown; known are {', '.join(known)}", path=path, field=f"board.{name}")
    return converted(given, type, path=path, within="board")  # type: ignore[no-any-return]
