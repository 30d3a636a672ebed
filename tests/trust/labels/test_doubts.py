"""What a landmark's name could explain at most, beside what it explains when it is really set free."""

from itertools import combinations

import pytest

from teamslam.joining import build, split
from teamslam.model import Submap
from teamslam.sim import Options, simulate
from teamslam.solver import Factor
from teamslam.trust.influence.liars import fit_of
from teamslam.trust.labels.changes import own_name
from teamslam.trust.labels.constellations import constellations, renamed
from teamslam.trust.labels.doubts import Doubts, doubts_of
from teamslam.trust.labels.search import _joined

SPACES = ("2d", "planar", "3d")
Stars = dict[int, list[Submap]]


def asked(space: str, seed: int) -> tuple[Stars, int, Doubts, float]:
    """The constellations of a team, a robot that shares much, its doubts, and what all cost together."""
    log = simulate(Options(space=space, robots=3, landmarks=12), seed)
    stars = constellations([build(piece) for piece in split(log)])
    robot = max(stars, key=lambda r: len(stars[r][0].landmark_keys))
    joined = _joined(stars)
    factor = Factor.of(joined.map.values.layout, joined.map.information)
    return stars, robot, doubts_of(stars[robot][0], joined.map, factor), fit_of(joined).cost


def cost_with(stars: Stars, robot: int, names: dict[int, int]) -> float:
    return fit_of(_joined({**stars, robot: [renamed(part, names) for part in stars[robot]]})).cost


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("space", SPACES)
def test_a_landmark_set_free_brings_what_was_promised(space: str, seed: int) -> None:
    stars, robot, doubts, cost = asked(space, seed)
    for key, promised in zip(doubts.keys.tolist()[:4], doubts.alone.tolist(), strict=False):
        brought = cost - cost_with(stars, robot, {key: own_name(robot, key)})
        assert brought == pytest.approx(promised, rel=0.02, abs=0.02)


@pytest.mark.parametrize("space", SPACES)
def test_no_exchange_explains_more_than_two_set_free(space: str) -> None:
    stars, robot, doubts, cost = asked(space, 1)
    for one, other in list(combinations(doubts.keys.tolist(), 2))[:6]:
        assert cost_with(stars, robot, {one: other, other: one}) > cost - 1.02 * doubts.two - 0.02
