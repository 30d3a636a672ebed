"""Tags as a field layout of WPILib, which PhotonVision and Limelight load too: what robots of FIRST localise by.

    {"tags": [{"ID": 7, "pose": {"translation": {"x": .., "y": .., "z": ..},
                                 "rotation": {"quaternion": {"W": .., "X": .., "Y": .., "Z": ..}}}}, ...],
     "field": {"length": .., "width": ..}}

There x of a tag points out of its face, y to the right of who reads it, z up; of ours these are z, x and y. Tags are
landmarks with a pose, whose name is a number. The field is the rectangle from the origin that holds all tags: put the
map into the field's own frame first (measure a tag in the world), or correct it by hand.

Source: edu.wpi.first.apriltag.AprilTagFieldLayout (JSON), WPILib's coordinate system (north, west, up).
"""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from teamslam.errors import InputError
from teamslam.geometry import Pose
from teamslam.io.files.text import write_text
from teamslam.io.maps.estimate import MapEstimate, paths_of
from teamslam.model import Dropped, Kind, is_landmark

OURS = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])  # WPILib's axes of a tag, as columns in ours


def write(maps: Sequence[MapEstimate], path: Path) -> tuple[Dropped, ...]:
    """Writes the tags of each map into a file of its own. InputError where there are none."""
    if not any(len(_tags(found)[0]) for found in maps):
        raise InputError(
            "this map has no tags: a field layout holds landmarks that were seen as poses, with numbers for names"
        )
    lost = 0
    for found, file in zip(maps, paths_of(path, len(maps)), strict=True):
        numbers, poses = _tags(found)
        lost += len(found.values) - len(numbers)
        write_text(file, json.dumps(layout_of(numbers, poses), indent=1) + "\n")
    return (Dropped(lost, "poses of robots, and landmarks that are no numbered tags"),) if lost else ()


def _tags(found: MapEstimate) -> tuple[list[int], Pose]:
    """The tags of a map by number, and their poses."""
    keys = found.values.layout.keys_of(Kind.POSE3)
    keys = keys[is_landmark(keys)]
    named = np.array([found.names.landmark(int(key)).isdigit() for key in keys], bool)
    keys = keys[named] if len(keys) else keys
    return [int(found.names.landmark(int(key))) for key in keys], found.values.poses_of(keys, 3)


def layout_of(numbers: list[int], poses: Pose) -> dict[str, object]:
    """The field layout of tags at poses (n,)."""
    turned = Pose(poses.rotation @ OURS, poses.translation)
    tags = [
        {
            "ID": number,
            "pose": {
                "translation": dict(zip("xyz", place, strict=True)),
                "rotation": {"quaternion": dict(zip("WXYZ", quaternion, strict=True))},
            },
        }
        for number, place, quaternion in zip(
            numbers, turned.translation.tolist(), turned.quaternion_wxyz().tolist(), strict=True
        )
    ]
    size = np.maximum(poses.translation[:, :2].max(0, initial=0.0), 0.0).tolist() if numbers else [0.0, 0.0]
    return {"tags": tags, "field": {"length": size[0], "width": size[1]}}
