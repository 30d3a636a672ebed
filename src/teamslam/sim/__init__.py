"""Made-up teams in made-up worlds, with their truth.

simulate(Options(space="3d", robots=5, poses=200), seed=7)
simulate(PaperOptions("minimum", poses=12), seed=7)          # the paper's section 3.1
simulate("mixed", seed=7)                                    # a row of PRESETS
simulate("2d", robots=5, landmarks=40)                       # a row of PRESETS with other options
"""

from dataclasses import fields, replace
from numbers import Real
from typing import Any

from teamslam.errors import InputError
from teamslam.model import Dataset, a_kind, is_whole, nearest
from teamslam.sim.motion import PATHS, Arena, drive
from teamslam.sim.noise import NOISES, Noise
from teamslam.sim.paper import NOISE_LEVELS, SCENARIOS, PaperOptions, simulate_paper
from teamslam.sim.scenario import SPACES, Options, Robot, observe, simulate_options
from teamslam.sim.sense import Odometry, Sensor
from teamslam.sim.world import World

__all__ = [
    "NOISES",
    "NOISE_LEVELS",
    "PATHS",
    "PRESETS",
    "SCENARIOS",
    "SPACES",
    "Arena",
    "Noise",
    "Odometry",
    "Options",
    "PaperOptions",
    "Robot",
    "Sensor",
    "World",
    "changed",
    "drive",
    "observe",
    "simulate",
]

_LIDAR = Sensor("range_bearing", sigma_m=0.05, sigma_rad=0.01, range_m=8.0, field_of_view_deg=270.0)
_TAGS = Sensor("relative_pose", sigma_m=0.03, sigma_rad=0.02, field_of_view_deg=120.0, mount_xyz_m=(0.1, 0.0, 0.3))

PRESETS: dict[str, Options | PaperOptions] = {
    "2d": Options(space="2d"),
    "planar": Options(space="planar"),
    "3d": Options(space="3d"),
    "lidar": Options(space="2d", path="lawn_mower", team=(Robot(landmarks=_LIDAR),)),
    "tags": Options(space="planar", team=(Robot(landmarks=_TAGS),)),
    "mixed": Options(space="3d", robots=4, team=(Robot(dim=2), Robot(dim=3))),
    "paper": PaperOptions("sufficient"),
    "paper_minimum": PaperOptions("minimum"),
}


def simulate(options: Options | PaperOptions | str = "planar", seed: int = 0, **changes: Any) -> Dataset:
    """What a team measures in a made-up world, with its truth: the same for the same options and seed.

    `options` may be the name of a row of PRESETS; `changes` are options by name, such as robots=5. InputError for a
    name that is not there, for an option that these have not, or a seed below zero.
    """
    options = changed(options, changes)
    if not is_whole(seed) or seed < 0:
        raise InputError(f"a seed is a whole number from 0 on, found {seed}", field="seed")
    return simulate_paper(options, seed) if isinstance(options, PaperOptions) else simulate_options(options, seed)


def changed(options: Options | PaperOptions | str, changes: dict[str, Any]) -> Options | PaperOptions:
    """Options, or a row of PRESETS by name, with some changed. InputError for a name that is not there."""
    if isinstance(options, str):
        if options not in PRESETS:
            raise InputError(f"unknown preset '{options}'; choose one of {', '.join(PRESETS)}", field="preset")
        options = PRESETS[options]
    if not isinstance(options, Options | PaperOptions):
        raise InputError(f"expected Options, PaperOptions or the name of a preset, found {a_kind(options)}")
    known = [field.name for field in fields(options)]
    for name in changes:
        if name not in known:
            raise InputError(f"these worlds have no option '{name}'; {nearest(name, known)}", field=name)
        now = getattr(options, name)
        if isinstance(now, Real) and not isinstance(changes[name], Real):
            raise InputError(f"expected a number, such as {now}; found {a_kind(changes[name])}", field=name)
    try:
        return replace(options, **changes)
    except TypeError as error:
        raise InputError(f"an option is of the wrong kind: {error}") from None
