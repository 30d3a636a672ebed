"""Your own CSV files: python examples/gallery/own_csv.py [FOLDER]

Without a folder it writes a small one: team.toml, and two CSV files that hold the rows of both robots.
"""

import math
import random
import sys
from pathlib import Path

import teamslam as ts

TEAM = """
[[robot]]
name = "red"
[[robot]]
name = "blue"
[[log]]
file = "odometry.csv"
model = "relative_pose"
sigma = [0.03, 0.03, 0.02]
[[log]]
file = "landmarks.csv"
model = "range_bearing"
sigma = [0.1, 0.02]
"""
WAYS = {"red": ((0.0, 0.0, 0.0), 0.12), "blue": ((4.0, 3.0, 1.6), -0.15)}  # where each starts, and how it turns
PLACES = {"door": (2.0, 4.5), "lamp": (6.5, 1.0), "tree": (-2.5, 2.5), "bin": (3.0, -1.5)}


def write(folder, draw):
    """What the two would log: how far they came, and what they saw."""
    odometry, seen = ["robot,from_stamp,to_stamp,x,y,theta"], ["robot,stamp,landmark,range,bearing"]
    for robot, ((x, y, heading), turn) in WAYS.items():
        for t in range(40):
            for name, (px, py) in PLACES.items():
                bearing = math.remainder(math.atan2(py - y, px - x) - heading, math.tau)
                far = math.hypot(px - x, py - y)
                seen.append(f"{robot},{t},{name},{draw.gauss(far, 0.1):.3f},{draw.gauss(bearing, 0.02):.4f}")
            step = f"{draw.gauss(0.5, 0.03):.3f},{draw.gauss(0, 0.03):.3f},{draw.gauss(turn, 0.02):.4f}"
            odometry.append(f"{robot},{t},{t + 1},{step}")
            x, y, heading = x + 0.5 * math.cos(heading), y + 0.5 * math.sin(heading), heading + turn
    folder.mkdir()
    for name, text in {
        "team.toml": TEAM,
        "odometry.csv": "\n".join(odometry),
        "landmarks.csv": "\n".join(seen),
    }.items():
        (folder / name).write_text(text)


folder = Path(sys.argv[1] if sys.argv[1:] else "log")
if not folder.exists():
    write(folder, random.Random(1))
team = ts.run(folder)
for landmark in team.landmarks:
    print(landmark)
ts.plot(team, title="Two robots from CSV files").savefig("own_csv.png")
