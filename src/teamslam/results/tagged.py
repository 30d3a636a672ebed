"""What people load into their robots of a map of tags: the folder tags/ of a run that was made of recordings.

    tags.csv         every tag: number, edge, pose, and the covariance of its pose
    tagslam.yaml     a body for TagSLAM with all tags where they are, and how well that is known
    bundles.yaml     bundles for apriltag_ros: the map, and each body that carries several tags
    wpilib.json      a field layout for WPILib, PhotonVision and Limelight

The edge of a tag is what the team file states: a map says where tags are, not how large. Poses are those of the tags'
own frames (x right, y up, z towards who reads it) in the frame of the map. Of several maps, those after the first have
`_part_2`, ... in their names.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from teamslam.answers.columns import POSE_COLUMNS, POSE_ERRORS, triangle
from teamslam.frontend.tags.rows import Tag
from teamslam.geometry import Array, Pose, so3
from teamslam.io.bags.team_file import TeamFile
from teamslam.io.files.text import write_text
from teamslam.io.maps import wpilib
from teamslam.io.maps.estimate import paths_of
from teamslam.model import Dropped, Kind, Submap, index_of
from teamslam.results.record import Record
from teamslam.solver import Covariances

FILES = ("tags.csv", "tagslam.yaml", "bundles.yaml", "wpilib.json")


@dataclass(frozen=True, eq=False)
class MappedTag:
    """A tag in a map: which of the maps, its number and edge, the landmark that carries it, its pose, and the
    covariance (6, 6) of its pose as [x, y, z in the map, turns about its own axes]."""

    part: int
    tag: Tag
    pose: Pose
    covariance: Array


def tags_of(record: Record, team: TeamFile) -> tuple[tuple[MappedTag, ...], tuple[Dropped, ...]]:
    """Every tag of the maps, and how many landmarks have no number of their own: one that stands at several places."""
    found, nameless = [], 0
    for part, (submap, covariances) in enumerate(zip(record.maps, record.covariances, strict=True), 1):
        for carrier, pose, covariance in _landmarks(submap, covariances):
            tags = _carried(carrier, team)
            nameless += not tags
            found += [_placed(part, tag, pose, covariance) for tag in tags]
    reason = "landmarks that are one of several places of a tag, which has one number"
    return tuple(found), (Dropped(nameless, reason),) if nameless else ()


def write_tags(record: Record, team: TeamFile, folder: Path) -> tuple[Dropped, ...]:
    """Write FILES into a folder, which is made; what they leave out. Nothing where no tag was mapped."""
    tags, dropped = tags_of(record, team)
    if not tags:
        return dropped
    write_text(folder / "tags.csv", _table(tags))
    count = len(record.maps)
    files = [paths_of(folder / name, count) for name in FILES[1:]]
    for part in range(1, count + 1):
        own = [tag for tag in tags if tag.part == part]
        if not own:
            continue
        tagslam, bundle, field = (paths[part - 1] for paths in files)
        write_text(tagslam, _tagslam(own))
        write_text(bundle, _bundles(own, team))
        poses = Pose(np.stack([t.pose.rotation for t in own]), np.stack([t.pose.translation for t in own]))
        layout = wpilib.layout_of([t.tag.number for t in own], poses)
        write_text(field, json.dumps(layout, indent=1) + "\n")
    return dropped


def _landmarks(submap: Submap, covariances: Covariances) -> Iterator[tuple[str, Pose, Array]]:
    """The landmarks of a map that have a pose: name, pose, covariance."""
    layout = submap.all_values.layout
    keys = submap.landmark_keys
    keys = keys[layout.kinds[layout.index(keys)] == Kind.POSE3]
    blocks, poses = covariances.blocks(keys), submap.all_values.poses_of(keys, 3)
    for k, number in enumerate(index_of(keys).tolist()):
        yield submap.names.landmark(number), poses[k], np.asarray(blocks[k])


def _carried(carrier: str, team: TeamFile) -> list[Tag]:
    """The tags of a landmark: those that the team file puts on it, or the one whose number is its name."""
    on_it = [tag for tag in team.carried().values() if not tag.is_robot and tag.carrier == carrier]
    if on_it or not carrier.isdigit():
        return on_it
    return [Tag(int(carrier), team.size_of(int(carrier)), carrier)]


def _placed(part: int, tag: Tag, pose: Pose, covariance: Array) -> MappedTag:
    """A tag of a landmark at `pose`. With x_tag = x + R t and R_tag = R Q, errors (dx, w) of the landmark become
    (dx - R [t] w, Q' w)."""
    if tag.pose is None:
        return MappedTag(part, tag, pose, covariance)
    J = np.eye(6)
    J[:3, 3:] = -pose.rotation @ so3.hat(tag.pose.translation)
    J[3:, 3:] = tag.pose.rotation.T
    return MappedTag(part, tag, pose @ tag.pose, J @ covariance @ J.T)


def _table(tags: Sequence[MappedTag]) -> str:
    columns = ("component", "landmark", "tag", "size_m", *POSE_COLUMNS[3], *triangle(POSE_ERRORS[3]))
    upper = np.triu_indices(6)
    lines = [
        ",".join(
            [
                str(t.part),
                t.tag.carrier if t.tag.carrier.isdigit() else json.dumps(t.tag.carrier),
                str(t.tag.number),
                repr(t.tag.size_m),
                *map(repr, t.pose.numbers().tolist()),
                *map(repr, t.covariance[upper].tolist()),
            ]
        )
        for t in tags
    ]
    return "\n".join([",".join(columns), *lines, ""])


def _tagslam(tags: Sequence[MappedTag]) -> str:
    """A static body whose tags are known, with their standard deviations."""
    lines = [
        "bodies:",
        " - map:",
        "     is_static: true",
        "     is_default_body: true",
        "     type: simple",
        "     tags:",
    ]
    for t in tags:
        sigmas = np.sqrt(np.maximum(np.diag(t.covariance), 1e-18)).tolist()
        lines += [f"       - id: {t.tag.number}", f"         size: {t.tag.size_m!r}", "         pose:"]
        for name, three in (
            ("position", t.pose.translation.tolist()),
            ("rotation", so3.log(t.pose.rotation).tolist()),
            ("position_noise", sigmas[:3]),
            ("rotation_noise", sigmas[3:]),
        ):
            lines.append(f"           {name}:")
            lines += [f"             {axis}: {value:.12g}" for axis, value in zip("xyz", three, strict=True)]
    return "\n".join([*lines, ""])


def _bundles(tags: Sequence[MappedTag], team: TeamFile) -> str:
    """The map as a bundle, and each body that carries tags: robots too."""
    bundles = [("map", [(t.tag.number, t.tag.size_m, t.pose) for t in tags])]
    for tag in team.carried().values():
        if bundles[-1][0] != tag.carrier:
            bundles.append((tag.carrier, []))
        bundles[-1][1].append((tag.number, tag.size_m, tag.pose or Pose.identity(3, ())))
    lines = ["standalone_tags: []", "tag_bundles:", "  ["]
    for name, members in bundles:
        lines += ["    {", f"      name: {json.dumps(name)},", "      layout:", "        ["]
        for number, size, pose in members:
            x, y, z = pose.translation.tolist()
            w, i, j, k = pose.quaternion_wxyz().tolist()
            lines.append(
                f"          {{id: {number}, size: {size!r}, x: {x:.12g}, y: {y:.12g}, z: {z:.12g}, "
                f"qw: {w:.12g}, qx: {i:.12g}, qy: {j:.12g}, qz: {k:.12g}}},"
            )
        lines += ["        ]", "    },"]
    return "\n".join([*lines, "  ]", ""])
