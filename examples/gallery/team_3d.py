"""A team in the air: python examples/gallery/team_3d.py

Four robots that move in space see landmarks by range, azimuth and elevation, and now and then each other.
"""

import teamslam as ts

log = ts.simulate("3d", robots=4, poses=80, landmarks=60, seed=3)
team = ts.run(log)

score = ts.score(team.map, log.truth)
print(f"robots {score.robot_position_rmse_m:.3f} m, landmarks {score.landmark_rmse_m:.3f} m off")
print(team.trajectory("2").quaternions_wxyz[-1], "is how robot 2 was turned at the end (w, x, y, z)")
print(team.relative("4@last", seen_from="2@last"))
ts.plot(team, title="Four robots in space", truth=log.truth).savefig("team_3d.png")
