"""Five real robots, start poses unknown: python examples/gallery/mrclam.py MRCLAM_Dataset6

The data are not part of teamslam: `teamslam data mrclam_6` says where they are.
"""

import sys

import teamslam as ts

log = ts.read(sys.argv[1])
team = ts.run(log)

score = ts.score(team.map, log.truth)
print(
    f"robots {score.robot_position_rmse_m:.3f} m, landmarks {score.landmark_rmse_m:.3f} m off, against motion capture"
)
print(f"NEES per degree of freedom {score.consistency.nees.per_dof:.2f}: 1 where covariances are honest")
ts.plot(team, title="MRCLAM: five robots, one map", truth=log.truth).savefig("mrclam.png")
