"""Robots on the ground and in the air in one map: python examples/gallery/mixed_team.py

Planar robots see points in space (range, azimuth, elevation); those in the air have six numbers a pose.
"""

import teamslam as ts

log = ts.simulate("mixed", poses=60, seed=4)
team = ts.run(log)

for robot in team.robots:
    way = team.trajectory(robot)
    kind = "in the air" if way.positions.shape[1] == 3 else "on the ground"
    print(f"robot {robot}: {kind}, at the end known to {way.sigmas[-1, :2].max():.3f} m")
print(f"landmarks off by {ts.score(team.map, log.truth).landmark_rmse_m:.3f} m")
ts.plot(team, title="Two robots on the ground, two in the air", truth=log.truth).savefig("mixed_team.png")
