"""Tags of a building from a ROS bag: python examples/gallery/tags_from_bags.py FOLDER_OF_TAGSLAM_TESTS

A stereo pair with odometry that jumps, and AprilTags on the walls. Needs `pip install 'teamslam[bags]'`.
The data are not part of teamslam: `teamslam data tagslam_building` says where they are.
"""

import sys
from pathlib import Path

import teamslam as ts

# Where the cameras are in the body that odometry moves: from the recording's own camera_poses.yaml and tagslam.yaml.
TEAM = """
[tags]
size_m = 0.15
[[robot]]
name = "eleven"
recording = "{here}/tag_detections.bag"
odometry = "/fla/vio/odom"
[[robot.camera]]
name = "left"
tags = "/fla/ovc_node/left/tags"
calibration = "{here}/cameras.yaml"
xyz_m = [0.025621, 0.020356, 0.021928]
quaternion_wxyz = [0.001361899, 0.004793728, 0.000373483, 0.999987513]
[[robot.camera]]
name = "right"
tags = "/fla/ovc_node/right/tags"
calibration = "{here}/cameras.yaml"
xyz_m = [-0.174682, 0.019236, 0.024787]
quaternion_wxyz = [0.000061450, -0.009442294, -0.000564238, -0.999955259]
"""

here = Path(sys.argv[1]).absolute() / "test_11"
Path("team.toml").write_text(TEAM.replace("{here}", here.as_posix()))

log = ts.read("team.toml")
for note in log.notes:
    print("read:", note)
team = ts.run(log)
print(f"{len(team.landmarks)} tags, {len(team.trajectory('eleven').stamps_s):,} poses; {team.verdict}")
print(team.landmark("79"))
ts.plot(team, title="Tags of a building, from a bag").savefig("tags_from_bags.png")
