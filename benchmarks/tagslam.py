"""Beside TagSLAM, on its own recordings: the table of docs/recordings.md, 'Beside TagSLAM'.

    python benchmarks/tagslam.py FOLDER      # with test_22 and test_23, as the tests unpack them in .cache/data

How late images are stamped is estimated, as in any run; TagSLAM is asked of the moments that images are stamped with.
Of each tag and camera the reprojection error of its corners [pixels], by our map and by TagSLAM's reference (tags and
rig of its `reference.bag`), over the same images; and how far our way of the camera is from TagSLAM's after one rigid
alignment. The median and the RMS both count, as each method lets some corners be wrong.
"""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import teamslam as ts
from teamslam.frontend.tags.rows import SQUARE
from teamslam.geometry import Pose, align
from teamslam.io.bags import opened, read_transforms
from teamslam.io.bags.recorded import cameras_of
from teamslam.io.bags.team_file import read_team_file
from teamslam.results.reprojection import reprojected

TEAMS = {
    "22": ("""[tags]
size_m = 0.42
[[robot]]
name = "rig"
recording = "{folder}/test_22/tag_detections.bag"
odometry = "/camera/odom/sample"
image_every_s = 0.0
[[robot.camera]]
name = "cam0"
tags = "/detector/tags/left"
calibration = "{folder}/test_22/cameras.yaml"
xyz_m = {xyz}
quaternion_wxyz = {quaternion}
""", "yard"),
    "23": ("""[tags]
size_m = 0.049
[[robot]]
name = "rig"
recording = "{folder}/test_23/tag_detections.bag"
image_every_s = 0.0
[[robot.camera]]
name = "cam0"
tags = "/camera/color/tags"
calibration = "{folder}/test_23/cameras.yaml"
""", "tag_board"),
}  # fmt: skip


def main(folder: Path) -> None:
    """Prints the tables."""
    for name in TEAMS:
        show(name, folder)


def show(name: str, folder: Path) -> None:
    """Of one recording."""
    text, body = TEAMS[name]
    with TemporaryDirectory() as place:
        path = Path(place) / "team.toml"
        path.write_text(text.format(folder=folder, **mount_of(folder / f"test_{name}")))
        result = ts.run(path)
        team = read_team_file(path)
        maps = [component.map for component in result.joined.components]
        (ours,) = reprojected(result.dataset, maps, team, Path(place))
        (camera,) = cameras_of(team.robot[0], Path(place))
    ways, late = reference(folder / f"test_{name}", body), 0
    for one in () if result.unknowns is None else result.unknowns.found:
        late += round(1e6 * one.value) if one.unknown.name == "latency" else 0
        of = f"{one.unknown.of}: {one.unknown.name}"
        print(f"recording {name}: {of} {one.value:.4f} +- {one.sigma:.4f} {one.unknown.unit}")
    theirs = np.full(ours.seen.shape, np.nan)
    for k, (tick, tag) in enumerate(zip(ours.ticks.tolist(), ours.tags.tolist(), strict=True)):
        seen = ways.tag_in_camera(tick + late, tag)
        if seen is not None:
            size = team.size_of(tag) * SQUARE
            theirs[k] = camera.project(seen.act(size))
    both = np.isfinite(theirs).all((-1, -2))
    off = {"teamslam": ours.off[both], "TagSLAM": np.linalg.norm(ours.seen[both] - theirs[both], axis=-1)}
    print(f"recording {name}: {len(maps)} maps, {both.sum()} of {len(both)} sightings in both")
    for tag in [None, *np.unique(ours.tags[both]).tolist()]:
        rows = np.ones(both.sum(), bool) if tag is None else ours.tags[both] == tag
        words = "  ".join(
            f"{who} median {np.median(e[rows]):.3f} RMS {np.sqrt(np.mean(e[rows] ** 2)):.3f}" for who, e in off.items()
        )
        print(f"  {'all' if tag is None else f'tag {tag}':8} {rows.sum():5}  {words}")
    submap = maps[0]
    keys = submap.trajectory_keys(1)
    ticks = ts.model.index_of(keys)
    poses = submap.all_values.poses_of(keys, 3) @ team.robot[0].camera[0].pose
    near = [ways.camera_at(int(tick) + late) for tick in ticks]
    held = [k for k, pose in enumerate(near) if pose is not None]
    true = np.array([near[k].translation for k in held])
    way = align(poses.translation[held], true).pose.act(poses.translation[held])
    away = np.linalg.norm(way - true, axis=1)
    print(
        f"  way of the camera, {len(held)} poses: median {np.median(away):.4f} m, RMS {np.sqrt(np.mean(away**2)):.4f} m"
    )


def mount_of(folder: Path) -> dict[str, list[float]]:
    """Where the camera is in the body that odometry moves: as the settings of the recording have it, else in its
    origin."""
    from ruamel.yaml import YAML

    settings = YAML(typ="safe", pure=True).load(folder / "tagslam.yaml")
    pose = Pose.identity(3, ())
    for entry in settings["bodies"]:
        rig = entry.get("rig", {})
        if "T_body_odom" in rig:
            numbers = [rig["T_body_odom"][part][axis] for part in ("position", "rotation") for axis in "xyz"]
            pose = Pose.from_tangent(np.array(numbers, float), 3).inverse()
    return {"xyz": pose.translation.tolist(), "quaternion": pose.quaternion_wxyz().tolist()}


class Reference:
    """TagSLAM's tags and rig, by when they were told [ticks]."""

    def __init__(self, tracks, body: str) -> None:
        self._of = {(track.parent, track.child): track for track in tracks}
        self._body = body

    def camera_at(self, tick: int) -> Pose | None:
        """The camera in the world, or, of a body that moves before a rig that stands, in the body."""
        rig, mount = self._at("map", "rig", tick), self._at("rig", "cam0", tick)
        body = self._at("map", self._body, tick)
        return None if rig is None or mount is None or body is None else body.inverse() @ rig @ mount

    def tag_in_camera(self, tick: int, tag: int) -> Pose | None:
        """A tag as the camera saw it."""
        camera, place = self.camera_at(tick), self._at(self._body, f"tag_{tag}", tick)
        return None if camera is None or place is None else camera.inverse() @ place

    def _at(self, parent: str, child: str, tick: int) -> Pose | None:
        track = self._of.get((parent, child))
        if track is None:
            return None
        k = int(np.argmin(np.abs(track.ticks - tick)))
        return track.poses[k] if abs(int(track.ticks[k]) - tick) < 20_000 else None


def reference(folder: Path, body: str) -> Reference:
    """Of a recording."""
    with opened(folder / "reference.bag") as recording:
        return Reference(read_transforms(recording), body)


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
