"""How sure is the map? Covariances of one variable, of several together, and of one seen from another.

A landmark far from the first robot's start has a large covariance in the map's frame; two landmarks beside each other
know of each other much better. Planning and grasping want the second: the relative covariance.

    python examples/04_covariances.py
"""

import numpy as np

import teamslam as ts
from teamslam.model import pose_key


def main():
    """Sigmas in the map's frame and as seen from a robot."""
    dataset = ts.simulate("planar", seed=4)
    team = ts.join([ts.build(piece) for piece in ts.split(dataset)])
    covariances = ts.Covariances.of_map(team.map)
    values = team.map.values

    last = int(dataset.pose_keys[2][-1])  # the last pose of robot 2
    print(f"{team.map.names.describe(last)}: sigma of x, y [m] and heading [rad] in the map's frame")
    print("   ", sigmas(covariances.of(last)))

    marks = team.map.landmark_keys
    all_at_once = covariances.blocks(marks)  # one factorisation, one pass: cheap for thousands
    spread = [np.sqrt(np.trace(block)) for block in all_at_once]
    best, worst = int(np.argmin(spread)), int(np.argmax(spread))
    print(f"landmarks: from {spread[best]:.3f} m (landmark {marks[best]}) to {spread[worst]:.3f} m ({marks[worst]})")

    joint = covariances.joint(marks[:2])
    print(f"two landmarks together: a {joint.shape[0]} x {joint.shape[1]} covariance, correlations and all")

    frames = pose_key(2, 0), pose_key(3, 0)  # where robots 2 and 3 started: nobody told
    apart = covariances.relative(values, int(frames[0]), int(frames[1]))
    print(f"robot 3's start seen from robot 2's: sigma {sigmas(apart)} (m, m, rad)")
    nearest = marks[np.argmin(np.linalg.norm(values.positions(marks, 2) - values.positions(last, 2), axis=-1))]
    seen = covariances.relative(values, last, int(nearest))
    print(f"the nearest landmark seen from the last pose: sigma {sigmas(seen)} m")


def sigmas(covariance):
    """Standard deviations."""
    return np.round(np.sqrt(np.diag(covariance)), 3)


if __name__ == "__main__":
    main()
