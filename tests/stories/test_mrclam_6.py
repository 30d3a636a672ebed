"""Five real robots with unknown start poses, mapped from the command line and scored against motion capture.

The bounds are those that the project promises: robots' positions to 0.08 m, landmarks' to 0.04 m (RMSE, one rigid
alignment of the whole team), by joining and by full least squares, with the reader's own noise model; and the
covariance of all variables together is as large as their errors.
"""

import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from teamslam.cli import main

ROOT = Path(__file__).parents[2]
ROBOTS_M, LANDMARKS_M = 0.08, 0.04
HONEST = (0.7, 1.6)  # NEES/dof of the whole


@pytest.mark.parametrize("method", ["join", "full"])
def test_the_map_is_as_good_as_promised(data: Callable[[str], Path], tmp_path: Path, method: str) -> None:
    """One command, no tuning, one map of all five robots."""
    arguments = ["run", str(data("mrclam_6")), "--out", str(tmp_path / method), "--method", method]
    code = main([*arguments, "--quiet", "--no-figures"])
    report = json.loads((tmp_path / method / "report.json").read_text())
    assert code == 0 and report["converged"] and report["components"] == 1
    assert report["robots"] == 5 and report["landmarks"] == 15 and report["dropped"] > 0
    assert report["robot_position_rmse_m"] <= ROBOTS_M
    assert report["landmark_rmse_m"] <= LANDMARKS_M
    assert HONEST[0] < report["nees_per_dof"] < HONEST[1]
    for page in ("README.md", "docs/gallery.md"):
        for said in said_of_a_run(ROOT / page, method):
            found = [report["robot_position_rmse_m"], report["landmark_rmse_m"], report["nees_per_dof"]]
            assert said == pytest.approx(found, abs=0.0015, rel=0.04), page


def said_of_a_run(page: Path, method: str) -> list[list[float]]:
    """What a page shows of it: robots' and landmarks' RMSE [m], NEES/dof."""
    text = page.read_text(encoding="utf-8")
    options = {"join": "--out joined", "full": "--out full --method full"}[method]
    rows = re.findall(rf"^\| `teamslam run MRCLAM_Dataset6 {options}` \| (\S+) m \| (\S+) m \| (\S+) /", text, re.M)
    case = r"robots (\S+) m, landmarks (\S+) m off, against motion capture\nNEES per degree of freedom (\S+)\n"
    rows += re.findall(case, text) if method == "join" else []
    assert rows or page.name == "gallery.md"
    return [[float(number) for number in row] for row in rows]
