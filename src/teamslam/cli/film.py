"""`teamslam film`: the paper's experiment as cameras would have filmed it, in recordings of ROS, with the truth."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from teamslam.cli.numbers import Whole

if TYPE_CHECKING:
    from teamslam.geometry import Pose
    from teamslam.io.bags.team_file import TeamFile
    from teamslam.pipeline import Progress
    from teamslam.sim.film import Film

DEPTH = "/camera/depth_registered/image_raw"
LOSS_SCALE = 12.0  # sigmas of a whole tag: few are odd here, and one that errs as its noise says counts for .95
EDGE_PX = 0.024  # by which the noise of grey values moves a point of an edge in focus


def film(
    out: Path,
    /,
    *,
    preset: str = "experiment",
    seed: Whole = 0,
    seconds: float | None = None,
    images_hz: float | None = None,
    to: str = "mcap",
) -> int:
    """Film two robots that carry cubes of tags through a room with four more, and write what they recorded.

    A recording for each robot, with odometry, images, depths, camera_info and true poses, and the team file that maps
    them. The same preset, options and seed give the same images, to the bit. Needs `pip install teamslam[tags]`.

    ```
    teamslam film lab
    teamslam run lab/team.toml --out lab-map
    teamslam film lab1 --seed 1 --to bag --seconds 30
    ```

    Presets:

    ```
    experiment     much like a Kinect: noise, motion blur, distortion, rolling shutter, an exposure that changes
    clocks         the same with clocks that are off by up to half a second and drift, and cameras that are late, as
                   clocks.json says and the team file does not; the robots shake where they look about, and have a gyro
    ideal          the same room by a camera that is nearly perfect
    board          a calibration board, leaned to all sides before a camera, for `teamslam calibrate`
    board-one-angle    the same from practically one angle, which leaves the focal length open
    ```

    Exit codes: 0 done; 2 bad input or usage.

    Parameters
    ----------
    out
        The folder to write; it must not exist.
    preset
        The camera: see above.
    seed
        Of everything that is drawn: places of tags, ways, noise.
    seconds
        How long; 60 without it.
    images_hz
        Images a second of each robot; 5 without it (of a board: 2).
    to
        mcap (ROS 2) or bag (ROS 1).
    """
    from dataclasses import replace
    from shlex import quote

    from teamslam.cli.console import answer, progress_bar, say
    from teamslam.cli.shown import PRESETS as BOARDS
    from teamslam.cli.shown import film_board
    from teamslam.errors import InputError
    from teamslam.io.bags.written import KINDS
    from teamslam.results.words import counted
    from teamslam.sim.film import PRESETS
    from teamslam.sim.film import film as filmed

    if out.exists():
        raise InputError("the output is there already; choose another name", path=out)
    if preset in BOARDS:
        return film_board(out, preset, seed, seconds, images_hz)
    if preset not in PRESETS:
        known = ", ".join((*PRESETS, *BOARDS))
        raise InputError(f"unknown preset '{preset}'; choose one of {known}", field="preset")
    if to not in KINDS:
        raise InputError(f"recordings are written as {' or '.join(KINDS)}, found '{to}'", field="to")
    options = PRESETS[preset]
    options = replace(
        options,
        seconds=options.seconds if seconds is None else seconds,
        images_hz=options.images_hz if images_hz is None else images_hz,
    )
    made = filmed(options, seed)
    with progress_bar() as progress:
        write_film(made, out, to, progress)
    frames = len(made.stamps_s) * len(made.robots)
    say(f"filmed: {counted(len(made.robots), 'robot', frames, 'image')}, and the truth")
    say(f"written: {out}")
    say(f"next: teamslam run {quote(str(out / 'team.toml'))} --out {quote(f'{out}-map')}")
    answer({"written": str(out), "robots": len(made.robots), "images": frames})
    return 0


def write_film(made: "Film", out: Path, to: str, progress: "Progress") -> None:
    """The recordings of a film and its team file, into a folder, which is made."""
    import json
    from dataclasses import asdict
    from itertools import tee

    from teamslam.io.bags.team_file import write_team_file
    from teamslam.io.bags.written import (
        KINDS,
        depth_messages,
        image_messages,
        odometry_messages,
        pose_messages,
        write_recording,
    )
    from teamslam.io.files.text import write_text
    from teamslam.results import made_folder

    team = team_of(made, KINDS[to])
    made_folder(out)
    for robot in made.robots:
        stage = f"filming robot {robot + 1}"

        def told(robot: int = robot, stage: str = stage):  # type: ignore[no-untyped-def]
            for k, frame in enumerate(made.frames(robot), 1):
                progress(stage, k, len(made.stamps_s))
                yield frame

        frames, again = tee(told())
        streams = (
            odometry_messages("/odom", made.odometry(robot)),
            pose_messages("/mocap/pose", made.truth(robot)),
            image_messages("/camera", ((f.tick, f.image) for f in frames), made.options.camera, "camera"),
            depth_messages(DEPTH, ((f.tick, f.depth) for f in again), "camera"),
        )
        write_recording(out / team.robot[robot].parts[0], to, streams)
    write_team_file(team, out / "team.toml")
    if made.options.off_clocks:
        write_text(out / "clocks.json", json.dumps(asdict(made.clocks), indent=1) + "\n")


def team_of(made: "Film", ending: str) -> "TeamFile":
    """The team file of a film: what its makers know, and nothing of what is to be found out but as truth."""
    from teamslam.frontend.way_noise import WayNoise
    from teamslam.io.bags.team_file import CameraEntry, CarriedTag, PlacedTag, RobotEntry, Tags, TeamFile
    from teamslam.sim.film.stage import CAMERA, FACE_TAG_M, TAG_M

    options = made.options
    motion = WayNoise(
        drift_m=options.drift_m, slip_m=options.slip_m, drift_rad=options.drift_rad, slip_rad=options.slip_rad
    )
    camera = CameraEntry(
        name="front",
        images="/camera/image_raw",
        depth=DEPTH,
        calibration="/camera/camera_info",
        xyz_m=tuple(CAMERA.translation.tolist()),
        quaternion_wxyz=tuple(CAMERA.quaternion_wxyz().tolist()),
        delay_s=options.delay_s,
        line_s=options.shutter.line_s,
        floor_px=0.0,
        edge_px=EDGE_PX,
        depth_floor=0.0,
    )

    def place(pose: "Pose") -> dict[str, Any]:
        turn = tuple(pose.quaternion_wxyz().tolist())
        return {"xyz_m": tuple(pose.translation.tolist()), "quaternion_wxyz": turn}

    robots = [
        RobotEntry(
            name=f"robot{k + 1}",
            recording=f"robot{k + 1}{ending}",
            odometry="/odom",
            truth="/mocap/pose",
            dim=2,
            motion=motion,
            camera=[camera],
            tag=[
                CarriedTag(number=number, size_m=FACE_TAG_M, **place(pose))
                for number, pose in made.stage.cubes[k].items()
            ],
        )
        for k in made.robots
    ]
    walls = [PlacedTag(number=number, **place(pose)) for number, pose in made.stage.walls.items()]
    return TeamFile(tags=Tags(size_m=TAG_M, loss_scale=LOSS_SCALE), robot=robots, truth=walls)
