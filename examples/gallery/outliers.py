"""Three sightings in ten are wrong: python examples/gallery/outliers.py

The same log mapped as it is, and with wrong sightings found and left out (`teamslam run LOG --reject`). Landmark 19 was
seen twice, at two places: nothing tells which of the two is right, and it stands at the wrong one.
"""

import teamslam as ts
from teamslam.config import TrustOptions
from teamslam.results import Record
from teamslam.results.figures import scene_of
from teamslam.sim import Robot, Sensor
from teamslam.viz import draw_maps

log = ts.simulate("2d", seed=5, team=(Robot(landmarks=Sensor(outliers=0.3)),))

scenes = {}
for name, trust in {"all believed": TrustOptions(), "wrong ones found and left out": TrustOptions(reject=True)}.items():
    team = ts.run(log, ts.Config(trust=trust))
    print(f"{name}: robots off by {ts.score(team.map, log.truth).robot_position_rmse_m:.3f} m; {team.verdict}")
    scenes[name] = scene_of(Record.of(team), 0)
draw_maps(scenes, "30 % of the sightings are wrong").savefig("outliers.png")
