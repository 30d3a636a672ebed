"""`teamslam simulate`: a team in a made-up world, with its truth."""

from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from teamslam.sim import Options, PaperOptions, Robot, Sensor

from teamslam.cli.numbers import MaybeWhole, Whole


def simulate(
    out: Path,
    /,
    *,
    preset: str = "planar",
    seed: Whole = 0,
    robots: MaybeWhole = None,
    poses: MaybeWhole = None,
    landmarks: MaybeWhole = None,
    path: str | None = None,
    outliers: float | None = None,
    dropouts: float | None = None,
    sigma_observation: float | None = None,
    sigma_odometry: float | None = None,
    to: str | None = None,
) -> int:
    """Make up a team in a world, and write its log with the truth.

    The same preset, options and seed give the same log, to the bit.

    ```
    teamslam simulate my-team
    teamslam simulate big --robots 8 --poses 300 --landmarks 100 --seed 7
    teamslam simulate rough --preset 3d --outliers 0.05 --dropouts 0.2
    teamslam simulate paper --preset paper --sigma-observation 0.3 --sigma-odometry 0.4
    ```

    Presets:

    ```
    2d        everything in the plane
    planar    robots on the ground, landmarks in space
    3d        everything in space
    lidar     ranges and bearings, in the plane
    tags      landmarks with an orientation, seen by robots on the ground
    mixed     robots on the ground and in the air in one team
    paper     the paper's three robots and three landmarks, sufficient sightings
    paper_minimum     the same with about the least that fixes the map
    ```

    Exit codes: 0 done; 2 bad input or usage.

    Parameters
    ----------
    out
        The folder (or file) to write; it must not exist.
    preset
        The world to begin with: see above. Options below change it.
    seed
        Of everything that is drawn.
    robots
        How many robots.
    poses
        How many poses each.
    landmarks
        How many landmarks.
    path
        How robots move: random_walk, circles or lawn_mower.
    outliers
        Share of sightings that are false.
    dropouts
        Share of sightings that are lost.
    sigma_observation
        Of the paper's presets: standard deviation of sightings [m, rad].
    sigma_odometry
        Of the paper's presets: standard deviation of odometry steps [m, rad].
    to
        The format to write; plain without it. See `teamslam convert --help`.
    """
    from shlex import quote

    from teamslam.cli.console import answer, say
    from teamslam.errors import InputError
    from teamslam.io import write
    from teamslam.results.words import counted
    from teamslam.sim import PRESETS
    from teamslam.sim import simulate as simulate_team

    if out.exists():
        raise InputError("the output is there already; choose another name", path=out)
    if preset not in PRESETS:
        raise InputError(f"unknown preset '{preset}'; choose one of {', '.join(PRESETS)}")
    given = {
        "robots": robots,
        "poses": poses,
        "landmarks": landmarks,
        "path": path,
        "sigma_observation": sigma_observation,
        "sigma_odometry": sigma_odometry,
    }
    options = _changed(PRESETS[preset], {name: value for name, value in given.items() if value is not None}, preset)
    options = _spoilt(options, {"outliers": outliers, "dropouts": dropouts}, preset)
    dataset = simulate_team(options, seed)
    left_out = write(dataset, out, to)
    rows = sum(len(t) for t in dataset.tables)
    say(f"simulated: {counted(len(dataset.robots), 'robot', rows, 'measurement')}, and the truth")
    say(f"written: {out}")
    for dropped in left_out:
        say(f"not as it was in the output: {dropped.count}: {dropped.reason}")
    say(f"next: teamslam run {quote(str(out))} --out {quote(f'{out}-map')}")
    answer({"written": str(out), "robots": len(dataset.robots), "rows": rows, "changed": [vars(d) for d in left_out]})
    return 0


def _changed(options: "Options | PaperOptions", given: dict[str, object], preset: str) -> "Options | PaperOptions":
    """The preset with the options given; InputError for one that it does not have."""
    from teamslam.errors import InputError

    known = {f.name for f in fields(options)}
    for name in given:
        if name not in known:
            raise InputError(f"the preset '{preset}' has no option --{name.replace('_', '-')}")
    return replace(options, **given)  # type: ignore[arg-type]


def _spoilt(options: "Options | PaperOptions", given: dict[str, float | None], preset: str) -> "Options | PaperOptions":
    """The preset with shares of outliers and drop-outs in every sensor that looks around."""
    shares = {name: share for name, share in given.items() if share is not None}
    if not shares:
        return options
    from teamslam.errors import InputError
    from teamslam.sim import Options

    if not isinstance(options, Options):
        raise InputError(f"the preset '{preset}' has neither outliers nor drop-outs")

    def sensor(seen: "Sensor | None") -> "Sensor | None":
        return seen and replace(seen, **shares)  # type: ignore[arg-type]

    def robot(kind: "Robot") -> "Robot":
        return replace(kind, landmarks=sensor(kind.landmarks), robots=sensor(kind.robots))

    return replace(options, team=tuple(robot(kind) for kind in options.team))
