"""Two robots of the plane that measure ranges to anchors, as a folder of CSV files with the truth."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from teamslam.geometry import Array

SIGMA_STEP = (0.02, 0.01, 0.005)  # m, m, rad
SIGMA_ANCHOR_M = 0.02
LOG = """
[[log]]
file = "{file}.csv"
model = "{model}"
sigma = {sigma}
"""
TRUTH = """
[truth]
robots = "robots.csv"
landmarks = "anchors.csv"
"""


def write_ranging(
    folder: Path,
    rng: np.random.Generator,
    ways: Mapping[str, Array],
    anchors: Mapping[str, tuple[float, float]],
    *,
    sigma_m: float,
    reach_m: float = np.inf,
    longer_m: Mapping[str, float] | None = None,
    surveyed: bool = False,
) -> Path:
    """The log of robots by name along their `ways` (n, 3) of x, y, theta, one pose a second: odometry, and the range to
    every one of the `anchors` within reach, some of which are `longer_m` than they are; with a survey of the anchors,
    or without."""
    rows: dict[str, list[str]] = {
        "odometry": ["robot,from_stamp,to_stamp,x,y,theta"],
        "ranges": ["robot,stamp,landmark,range"],
        "robots": ["robot,stamp,x,y,theta"],
        "anchors": ["landmark,x,y", *(f"{name},{x},{y}" for name, (x, y) in anchors.items())],
    }
    for robot, way in ways.items():
        for k, (x, y, theta) in enumerate(way):
            rows["robots"].append(f"{robot},{k},{x},{y},{theta}")
            if k + 1 < len(way):
                ahead, aside, turn = _step(way[k], way[k + 1]) + rng.normal(size=3) * SIGMA_STEP
                rows["odometry"].append(f"{robot},{k},{k + 1},{ahead},{aside},{turn}")
            for name, (to_x, to_y) in anchors.items():
                if (far := np.hypot(to_x - x, to_y - y)) < reach_m:
                    more = (longer_m or {}).get(name, 0.0)
                    rows["ranges"].append(f"{robot},{k},{name},{far + more + sigma_m * rng.normal()}")
    logs = [("odometry", "relative_pose", list(SIGMA_STEP)), ("ranges", "range", [sigma_m])]
    if surveyed:
        places = ((name, rng.normal(place, SIGMA_ANCHOR_M)) for name, place in anchors.items())
        rows["survey"] = ["landmark,x,y", *(f"{name},{x},{y}" for name, (x, y) in places)]
        logs.append(("survey", "position", [SIGMA_ANCHOR_M] * 2))
    team = "".join(f'[[robot]]\nname = "{robot}"\n' for robot in ways)
    team += "".join(LOG.format(file=file, model=model, sigma=sigma) for file, model, sigma in logs)
    folder.mkdir(exist_ok=True)
    for file, lines in rows.items():
        (folder / f"{file}.csv").write_text("\n".join(lines) + "\n")
    (folder / "team.toml").write_text(team + TRUTH)
    return folder


def _step(here: Array, there: Array) -> Array:
    """From one pose to the next, seen from the one."""
    c, s = np.cos(here[2]), np.sin(here[2])
    x, y, turn = there - here
    return np.array([c * x + s * y, c * y - s * x, turn])
