"""The stage: a room with tags on its walls, and robots that drive in it and carry a cube of tags each.

The paper's experiment (section 3.2): 5 x 5 m, four tags, two robots with differential drives, cubes of 14 cm. Which
ways they drove it does not say. Here each goes round and round on a wavy circle, one outside counter-clockwise, the
other inside clockwise, and never come nearer than half a metre. Now and then a robot stands and looks about.
"""

from dataclasses import dataclass

import numpy as np

from teamslam.geometry import Array, Pose
from teamslam.sim.film.boards import Board, box, facing, tag_board

SIDE_M, HEIGHT_M = 5.0, 2.5
TAG_M = 0.16  # on the walls
CUBE_M = 0.14
FACE_TAG_M = CUBE_M * 8 / 10  # with its white margin it fills the face
CAMERA = Pose(
    np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.array([0.12, 0.0, 0.30])
)  # z ahead, x to the right
FIRST_ON_CUBE = (100, 200)
WAYS = ((1.40, 0.20, 1.8), (0.60, 0.10, -1.8))  # radius, waves [m], angle of a leg [rad]
LEG_S, DRIVES = 15.0, 0.45  # of a leg, and which share of it is driven
SHAKE_S = 2.0  # to and fro


@dataclass(frozen=True, eq=False)
class Way:
    """A wavy circle, driven leg by leg: radius and waves [m], angle at the start, phase of the waves, the angle of a
    leg (below zero: clockwise) and its time [s]. After each leg the robot stands and turns once about itself, to and
    fro by `shakes` [rad] meanwhile."""

    radius_m: float
    waves_m: float
    start: float
    phase: float
    leg: float
    leg_s: float
    shakes: float = 0.0

    def at(self, t: Array) -> Array:
        """x, y, heading (..., 3) at times (...,) [s]; driving, the heading is that of the motion."""
        legs, within = np.divmod(np.asarray(t, float) / self.leg_s, 1.0)
        a = self.start + self.leg * (legs + _gently(within / DRIVES))
        stands = np.clip((within - DRIVES) / (1.0 - DRIVES), 0.0, 1.0)
        looking = 2.0 * np.pi * (legs + _gently(stands))
        looking = looking + self.shakes * np.sin(np.pi * stands) ** 2 * np.sin(2.0 * np.pi * np.asarray(t) / SHAKE_S)
        r = self.radius_m + self.waves_m * np.sin(4.0 * a + self.phase)
        grows = 4.0 * self.waves_m * np.cos(4.0 * a + self.phase)
        sense = np.sign(self.leg)
        ahead = np.arctan2(sense * (grows * np.sin(a) + r * np.cos(a)), sense * (grows * np.cos(a) - r * np.sin(a)))
        return np.stack([r * np.cos(a), r * np.sin(a), ahead + looking], -1)


def _gently(share: Array) -> Array:
    """From 0 to 1, beginning and ending at rest."""
    share = np.clip(share, 0.0, 1.0)
    return share * share * (3.0 - 2.0 * share)


@dataclass(frozen=True, eq=False)
class Stage:
    """Everything in a film: tags on walls (number: pose), what else hangs there, and for each robot its way, the boards
    that it carries and the tags among them (number: pose in the body)."""

    walls: dict[int, Pose]
    posters: tuple[Board, ...]
    ways: tuple[Way, ...]
    cubes: tuple[dict[int, Pose], ...]

    @property
    def hanging(self) -> list[Board]:
        """All boards of the room; those behind first."""
        return [*self.posters, *(tag_board(number, TAG_M, pose) for number, pose in self.walls.items())]

    def carried(self, robot: int) -> list[Board]:
        """The boards of a robot, in its body."""
        grey = (0.12, 0.3)[robot % 2]
        body = box((0.30, 0.30, 0.20), np.array([-0.05, 0.0, 0.14]), grey)
        post = box((0.03, 0.03, 0.20), np.array([-0.10, 0.0, 0.34]), 0.4)
        lid = Board(Pose(np.eye(3), np.array([-0.10, 0.0, 0.45 + CUBE_M / 2])), (CUBE_M, CUBE_M), np.full((1, 1), 0.8))
        faces = [tag_board(number, FACE_TAG_M, pose) for number, pose in self.cubes[robot].items()]
        return [*body, *post, *faces, lid]


def experiment(rng: np.random.Generator, shakes: float = 0.0) -> Stage:
    """The paper's experiment, its places drawn; robots shake by so much [rad] where they look about."""
    walls = {side: _on_wall(side, rng.uniform(-1.2, 1.2), rng.uniform(0.35, 0.75), 0.01) for side in range(4)}
    posters = []
    for side in range(4):
        for place in (-1.9, 1.9):
            picture = rng.uniform(0.1, 0.8, tuple(rng.integers(1, 4, 2)))
            size = float(rng.uniform(0.3, 0.8)), float(rng.uniform(0.3, 0.9))
            posters.append(Board(_on_wall(side, place, rng.uniform(0.7, 1.4), 0.005), size, picture))
    start = rng.uniform(-np.pi, np.pi)
    ways = tuple(
        Way(radius, waves, start + k * rng.uniform(2.0, 4.0), rng.uniform(-np.pi, np.pi), leg, LEG_S, shakes)
        for k, (radius, waves, leg) in enumerate(WAYS)
    )
    return Stage(walls, tuple(posters), ways, tuple(_cube(first) for first in FIRST_ON_CUBE))


def _on_wall(side: int, along_m: float, height_m: float, off_m: float) -> Pose:
    """On one of the four walls, looking inwards."""
    outwards = side * np.pi / 2
    out = np.array([np.cos(outwards), np.sin(outwards)])
    place = (SIDE_M / 2 - off_m) * out + along_m * np.array([-out[1], out[0]])
    return facing(outwards + np.pi, np.array([*place, height_m]))


def _cube(first: int) -> dict[int, Pose]:
    centre = np.array([-0.10, 0.0, 0.45])
    angles = np.arange(4) * np.pi / 2
    return {
        first + k: facing(a, centre + CUBE_M / 2 * np.array([np.cos(a), np.sin(a), 0.0]))
        for k, a in enumerate(angles.tolist())
    }
