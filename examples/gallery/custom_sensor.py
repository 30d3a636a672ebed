"""A sensor of your own: python examples/gallery/custom_sensor.py

How loud a beacon is, z = -20 log10(distance) [dB]: two functions, no derivatives. It helps a poor camera.
"""

from dataclasses import replace

import numpy as np

import teamslam as ts
from teamslam.model import MODELS, Model, whitening
from teamslam.results import Record
from teamslam.results.figures import scene_of
from teamslam.sim import Robot, Sensor
from teamslam.viz import draw_maps


def loudness(observer, target, dim):
    """What should be heard, (m, 1) [dB]."""
    place = target.translation if isinstance(target, ts.Pose) else target
    return -20.0 * np.log10(np.linalg.norm(place - observer.translation, axis=-1, keepdims=True))


MODELS["loudness"] = Model(loudness, lambda z, h, dim: z - h, size=(1, 1), rows=(1, 1))

camera = Sensor("range_bearing", sigma_m=0.8, sigma_rad=0.15, range_m=8.0)
log = ts.simulate("2d", robots=2, landmarks=12, seed=9, team=(Robot(landmarks=camera, robots=None),))
seen = [table for table in log.tables if table.source == "landmarks"]
rng = np.random.default_rng(9)
heard = []
for table in seen:
    poses = log.truth.poses_of(table.keys[:, 0], 2)
    true = loudness(poses, log.truth.positions(table.keys[:, 1], 2), 2)
    values, noise = true + rng.normal(0, 0.2, true.shape), whitening(np.array([[0.2**2]]))[None]
    heard.append(replace(table, source="radio", model="loudness", values=values, whitening=noise))

scenes = {}
for name, tables in {"camera alone": log.tables, "camera and radio": (*log.tables, *heard)}.items():
    team = ts.run(log.with_tables(tables))
    print(f"{name}: beacons off by {ts.score(team.map, log.truth).landmark_rmse_m:.2f} m")
    scenes[name] = scene_of(Record.of(team), 0)
draw_maps(scenes, "Beacons seen by a poor camera, and heard").savefig("custom_sensor.png")
