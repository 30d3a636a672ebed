"""Rows that come as lines, one by one."""

import json
from pathlib import Path

from teamslam.io.plain.lines import REMEMBERED, Lines

TEAM = """
[[robot]]
name = "red"
[[log]]
file = "odometry.csv"
model = "relative_pose"
sigma = [0.1, 0.1, 0.1]
"""


def test_a_row_without_an_id_that_comes_again_is_the_same_row(tmp_path: Path) -> None:
    """A link that is not sure of itself sends rows twice, and a step counts once; another step of the same numbers has
    another stamp. What was forgotten counts anew: memory ends somewhere."""
    (tmp_path / "team.toml").write_text(TEAM)
    (tmp_path / "odometry.csv").write_text("robot,from_stamp,to_stamp,x,y,theta\n")
    lines = Lines(tmp_path)

    def told(step: int, **more: float) -> int:
        row = {"file": "odometry.csv", "from_stamp": step, "to_stamp": step + 1, "x": 1.0, "y": 0.0, "theta": 0.1}
        return int(lines.row(json.dumps(row | more)).ids[0])

    assert [told(0), told(0), told(1), told(0), told(2)] == [0, 0, 1, 0, 2]
    assert told(0, x=1.5) == 3, "another row, though of the same step"
    assert told(3, id=7) == told(3, id=7) == 7, "an id says it by itself"
    first = told(10)
    assert [told(11 + n) for n in range(REMEMBERED)][-1] == first + REMEMBERED
    assert told(11) == first + 1 and told(10) == first + REMEMBERED + 1
