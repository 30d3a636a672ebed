"""Your own data in five minutes: a folder with team.toml and CSV files, as a spreadsheet or pandas writes them.

Two rovers drive past four landmarks; each logs odometry and what its camera sees. Nobody knows where they started.
This script writes such a folder, `my-team`, and maps it. Replace its files by yours: docs/formats.md has every column.

    python examples/02_own_data.py
    teamslam info my-team                   # the same from the command line
    teamslam run my-team --out my-map
"""

import csv
from pathlib import Path

import numpy as np

import teamslam as ts

TEAM_TOML = """
[[robot]]
name = "red"

[[robot]]
name = "blue"

[[log]]                                  # one row a step: how far, and how the heading changed
file = "odometry.csv"
model = "relative_pose"
sigma = [0.05, 0.05, 0.02]               # m, m, rad: standard deviations of each step

[[log]]                                  # one row a sighting: how far, in which direction (left is positive)
file = "landmarks.csv"
model = "range_bearing"
sigma = [0.10, 0.03]                     # m, rad
loss = "huber"                           # a wrong sighting now and then does no harm
loss_scale = 2.0
"""

LANDMARKS = {"door": (4.0, 3.0), "tree": (0.0, 6.0), "bin": (-3.0, 1.0), "lamp": (2.0, -3.0)}
STARTS = {"red": (0.0, 0.0, 0.0), "blue": (3.0, 4.0, 2.5)}


def make_up_logs(rng):
    """Rows as a robot would log them: odometry steps, and the landmarks within 6 m."""
    odometry, sightings = [], []
    for robot, start in STARTS.items():
        pose = ts.Pose.from_xytheta(np.array(start))
        for stamp in range(30):
            for name, place in LANDMARKS.items():
                x, y = pose.unact(np.array(place))
                if np.hypot(x, y) < 6.0:
                    sightings.append(
                        [
                            robot,
                            stamp,
                            name,
                            np.hypot(x, y) + rng.normal(0, 0.10),
                            np.arctan2(y, x) + rng.normal(0, 0.03),
                        ]
                    )
            step = np.array([0.4, 0.0, 0.2])
            pose = pose @ ts.Pose.from_xytheta(step)
            odometry.append([robot, stamp, stamp + 1, *(step + rng.normal(size=3) * [0.05, 0.05, 0.02])])
    return odometry, sightings


def write_folder(folder, odometry, sightings):
    """The folder that teamslam reads."""
    folder.mkdir(exist_ok=True)
    (folder / "team.toml").write_text(TEAM_TOML)
    write_csv(folder / "odometry.csv", ["robot", "from_stamp", "to_stamp", "x", "y", "theta"], odometry)
    write_csv(folder / "landmarks.csv", ["robot", "stamp", "landmark", "range", "bearing"], sightings)


def write_csv(path, header, rows):
    """One table."""
    with open(path, "w", newline="") as file:
        csv.writer(file).writerows([header, *rows])


def main():
    """Write the folder, read it, map it."""
    write_folder(Path("my-team"), *make_up_logs(np.random.default_rng(2)))

    dataset = ts.read("my-team")
    team = ts.join([ts.build(piece) for piece in ts.split(dataset)])

    print(team.components[0].solution.status.value)
    for key in team.map.landmark_keys:
        x, y = team.map.values.positions(key, 2)
        sx, sy = np.sqrt(np.diag(ts.Covariances.of_map(team.map).of(key)))
        print(f"{dataset.names.landmark(key):5} at {x:6.2f} ± {sx:.2f}, {y:6.2f} ± {sy:.2f} m (seen from red's start)")


if __name__ == "__main__":
    main()
