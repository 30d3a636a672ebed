"""map.npz: the map of the first component as plain arrays, for anyone with numpy and nothing else.

keys (n,)      robot << 51 | tick for a robot's pose, the number for a landmark
robots (n,)    the robot of each variable, 0 for a landmark;   stamps_s (n,)  of poses [s], nan for landmarks
kinds (n,)     0 pose of the plane, 1 pose of space, 2 point of the plane, 3 point of space
starts (n+1,)  where each variable begins in `state`;          dofs (n,)      how many unknowns it has
state          poses as T, then R row by row; points as they are; in the frame of the base pose
base           the key of the pose that is the frame (not among keys); -1: the world
information_data, information_indices, information_indptr      the information matrix over all unknowns, CSR:
               scipy.sparse.csr_array((data, indices, indptr)); its inverse is the covariance
"""

from pathlib import Path

import numpy as np

from teamslam.io.files.npz import write_arrays
from teamslam.model import Submap, is_pose, robot_of


def write_archive(submap: Submap, path: Path) -> None:
    """Write a map's arrays."""
    layout = submap.values.layout
    poses = is_pose(layout.keys)
    arrays = {
        "keys": layout.keys,
        "robots": robot_of(layout.keys),
        "stamps_s": np.where(poses, submap.names.stamps_s(layout.keys), np.nan),
        "kinds": layout.kinds,
        "starts": layout.state_start,
        "dofs": layout.dofs,
        "state": submap.values.state,
        "base": np.array(submap.base),
        "information_data": submap.information.data,
        "information_indices": submap.information.indices,
        "information_indptr": submap.information.indptr,
    }
    write_arrays(path, arrays)
