"""From a folder to a map that is asked by name, and one page that shows it: python examples/06_newcomer.py [FOLDER]"""

import sys
from pathlib import Path

import teamslam as ts

folder = Path(sys.argv[1] if sys.argv[1:] else "log")
if not folder.exists():
    ts.write(ts.simulate("2d", robots=3, seed=6), folder)  # no log at hand: one is made up

team = ts.run(folder)
print(team)
for landmark in list(team.landmarks)[:5]:
    print(landmark)  # its name, where it is, its 95 % region
for robot in team.robots:
    print(team.trajectory(robot).to_dataframe().tail(2))
for row in team.residuals().worst(3):
    print(row)
ts.plot(team).savefig("map.png")
ts.write_run(team, "map", replace=True)
print("look at map.png, and at map/report.html in a browser")
