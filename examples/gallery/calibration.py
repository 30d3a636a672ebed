"""Sigmas that are wrong, found in the data and put right: python examples/gallery/calibration.py

The log states its sightings three times better than they are. `teamslam run LOG` does the same.
"""

from dataclasses import replace

import teamslam as ts
from teamslam.results import Record
from teamslam.results.figures import scene_of
from teamslam.viz import draw_maps

log = ts.simulate("2d", robots=3, poses=80, seed=6)
log = log.with_tables(replace(t, whitening=3 * t.whitening) if t.source == "landmarks" else t for t in log.tables)

scenes = {}
for name, calibrate in {"as stated": False, "calibrated": True}.items():
    team = ts.run(log, ts.Config(calibrate=calibrate))
    nees = ts.score(team.map, log.truth).consistency.nees.per_dof
    print(f"{name}: NEES per degree of freedom {nees:.2f} (1 where covariances are honest)")
    scenes[f"{name}: NEES / dof {nees:.2f}"] = scene_of(Record.of(team), 0)
for sentence in Record.of(team).report["calibration"]["sentences"]:
    print("put right:", sentence)
draw_maps(scenes, "Sightings said to be three times better than they are").savefig("calibration.png")
