"""A sensor of your own: one row in MODELS, no derivative to write.

A robot drives a circle among three radio beacons. It sees them with a poor camera (range and bearing), and it hears how
strong they are: signal strength in decibels, z = -20 log10(distance). The second sensor is not part of teamslam; the
two functions below are all it takes.

    python examples/05_own_sensor.py
"""

import numpy as np

import teamslam as ts
from teamslam.model import MODELS, Model, landmark_key, pack, pose_key, whitening


def signal_strength(observer, target, dim):
    """What should be heard, (m, 1) [dB]: `target` is a position, or a pose whose position is meant."""
    place = target.translation if isinstance(target, ts.Pose) else target
    distance = np.linalg.norm(place[..., :dim] - observer.translation[..., :dim], axis=-1, keepdims=True)
    return -20.0 * np.log10(distance)


def difference(z, h, dim):
    """How two measurements differ: here simply z - h."""
    return z - h


MODELS["signal_strength"] = Model(signal_strength, difference, size=(1, 1), rows=(1, 1))


def a_log(rng):
    """The robot's log as tables, made up here; yours come from files."""
    n, beacons = 30, np.array([[8.0, 0.0], [-3.0, 7.0], [-4.0, -6.0]])
    angle = np.linspace(0.0, 2.0 * np.pi, n)
    way = ts.Pose.from_xytheta(np.stack([5 * np.cos(angle), 5 * np.sin(angle), angle + np.pi / 2], -1))
    poses, marks = pose_key(1, np.arange(n)), landmark_key(np.arange(len(beacons)))

    steps = way[:-1].between(way[1:]).retract(rng.normal(size=(n - 1, 3)) * [0.02, 0.02, 0.01])
    odometry_noise = whitening(np.diag([0.02, 0.02, 0.01]) ** 2)[None]
    odometry = ts.Table(
        1,
        "odometry",
        "relative_pose",
        2,
        np.stack([poses[:-1], poses[1:]], -1),
        pack(steps),
        odometry_noise,
        ids(n - 1),
    )

    who, what = (a.ravel() for a in np.meshgrid(np.arange(n), np.arange(len(beacons)), indexing="ij"))
    keys = np.stack([poses[who], marks[what]], -1)
    seen = way[who].unact(beacons[what])
    bearing = np.arctan2(seen[:, 1], seen[:, 0])
    camera = np.stack([np.linalg.norm(seen, axis=-1), bearing], -1) + rng.normal(size=seen.shape) * [1.0, 0.2]
    sightings = ts.Table(
        1, "landmarks", "range_bearing", 2, keys, camera, whitening(np.diag([1.0, 0.2]) ** 2)[None], ids(len(keys))
    )

    heard = signal_strength(way[who], beacons[what], 2) + rng.normal(size=(len(keys), 1)) * 0.5
    radio = ts.Table(1, "radio", "signal_strength", 2, keys, heard, whitening(np.array([[0.25]]))[None], ids(len(keys)))
    return odometry, sightings, radio, beacons, way


def ids(count):
    """Rows of the robot's log, numbered: so that no sighting is ever counted twice."""
    return np.arange(count)


def main():
    """Beacons' errors and sigmas, without and with the radio."""
    odometry, camera, radio, beacons, way = a_log(np.random.default_rng(5))
    for name, tables in (("camera alone", (odometry, camera)), ("camera and radio", (odometry, camera, radio))):
        submap = ts.build(ts.Dataset({1: 2}, tables))
        marks = submap.landmark_keys
        places = way[0].act(submap.values.positions(marks, 2))  # from the robot's first pose to the world
        sigmas = [np.sqrt(np.trace(c)) for c in ts.Covariances.of_map(submap).blocks(marks)]
        errors = np.linalg.norm(places - beacons, axis=-1)
        print(f"{name}: beacons off by {np.round(errors, 2)} m, expected about {np.round(sigmas, 2)} m")


if __name__ == "__main__":
    main()
