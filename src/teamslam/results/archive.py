"""map.npz: the map as plain arrays, for anyone with numpy and nothing else.

keys (n,)      robot << 51 | tick for a robot's pose, the number for a landmark
robots (n,)    the robot of each variable, 0 for a landmark;   stamps_s (n,)  of poses [s], nan for landmarks
kinds (n,)     0 pose of the plane, 1 pose of space, 2 point of the plane, 3 point of space
starts (n+1,)  where each variable begins in `state`;          dofs (n,)      how many unknowns it has
state          poses as T, then R row by row; points as they are; in the frame of the base pose
base           the key of the pose that is the frame (not among keys); -1: the world
information_data, information_indices, information_indptr      the information matrix over all unknowns, CSR:
               scipy.sparse.csr_array((data, indices, indptr)); its inverse is the covariance
parts          how many maps there are. The arrays above are of the first; those of further ones, which cannot be joined
               to it and have frames of their own, are called part_2_keys and so on
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from teamslam.io.files.npz import write_arrays
from teamslam.model import Submap, is_pose, robot_of


def write_archive(maps: Sequence[Submap], path: Path) -> None:
    """Write the arrays of all components."""
    arrays: dict[str, np.ndarray] = {"parts": np.array(len(maps))}
    for number, submap in enumerate(maps, 1):
        prefix = "" if number == 1 else f"part_{number}_"
        arrays |= {prefix + name: array for name, array in _arrays(submap).items()}
    write_arrays(path, arrays)


def _arrays(submap: Submap) -> dict[str, np.ndarray]:
    layout = submap.values.layout
    poses = is_pose(layout.keys)
    return {
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
