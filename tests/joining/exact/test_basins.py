"""The search for other optima: what it finds, and how much it may cost, by counts of factorisations and of looks."""

from collections.abc import Iterator, Sequence

import numpy as np
import pytest

from teamslam.geometry import Pose, concatenate
from teamslam.joining import build_choices, exact_join, full, join, split
from teamslam.joining.exact import basins
from teamslam.joining.exact.alone import excess_alone, excess_together
from teamslam.joining.join.join import Joined
from teamslam.model import Dataset, Submap, Table, Values, pack, pose_key, pose_kind
from teamslam.solver import Factor, System, optimise
from worlds import WORLDS, team


class Counter:
    """How often a solver's matrices were factorised, and what a search did."""

    factorisations = solves = alone = together = 0


@pytest.fixture
def counter(monkeypatch: pytest.MonkeyPatch) -> Iterator[Counter]:
    counted, factorise = Counter(), Factor.factorise

    def counting(factor: Factor, *given: np.ndarray) -> None:
        counted.factorisations += 1
        factorise(factor, *given)

    monkeypatch.setattr(Factor, "factorise", counting)
    yield counted


def rows_of_robots(robots: int, poses: int = 8, seed: int = 0) -> Dataset:
    """Robots side by side on lines of a grid, each step and each sight of the next robot known to 1 m and 1 rad."""
    rng = np.random.default_rng(seed)
    keys = [pose_key(robot, np.arange(poses)) for robot in range(1, robots + 1)]
    lines = [
        Pose.from_xytheta(np.stack([np.arange(poses), np.full(poses, y), np.zeros(poses)], -1)) for y in range(robots)
    ]

    def seen(robot: int, source: str, links: np.ndarray, one: Pose, other: Pose) -> Table:
        steps = one.between(other).retract(rng.normal(0.0, 0.3, (len(links), 3)))
        return Table(robot, source, "relative_pose", 2, links, pack(steps), np.eye(3)[None], np.arange(len(links)))

    tables = []
    for n, (own, way) in enumerate(zip(keys, lines, strict=True)):
        tables.append(seen(n + 1, "odometry", np.stack([own[:-1], own[1:]], -1), way[:-1], way[1:]))
        if n + 1 < robots:
            tables.append(seen(n + 1, "robots", np.stack([own, keys[n + 1]], -1), way, lines[n + 1]))
    truth = Values.of({pose_kind(2): (np.concatenate(keys), concatenate(lines))})
    return Dataset(dict.fromkeys(range(1, robots + 1), 2), tuple(tables), truth=truth)


def from_the_truth(log: Dataset, counter: Counter) -> tuple[float, int]:
    """The optimum that one solve finds from the truth, and its factorisations."""
    assert log.truth is not None
    before = counter.factorisations
    system = System(log.truth.layout, tables=log.tables, fixed=log.pose_keys[1][:1])
    return optimise(system, log.truth).cost, counter.factorisations - before


@pytest.mark.parametrize("way", ["full", "exact"])
@pytest.mark.parametrize("robots", [2, 8])
def test_weak_rows_of_robots_end_in_the_optimum(robots: int, way: str, counter: Counter) -> None:
    log = rows_of_robots(robots)
    found = full(log) if way == "full" else exact_join(split(log))
    least, _ = from_the_truth(log, counter)
    assert found.converged and len(found.components) == 1
    assert found.components[0].map.cost == pytest.approx(least, rel=1e-6)


@pytest.mark.parametrize("robots", [4, 12])
def test_looks_are_counted(robots: int) -> None:
    """Where no way but the first is better: one solve, a look alone at each of the others, few at the whole."""
    log = rows_of_robots(robots)
    choices, looks = [build_choices(piece) for piece in split(log)], Counter()

    def solve(submaps: Sequence[Submap]) -> Joined:
        looks.solves += 1
        return full(log, initial=join(submaps))

    def alone(joined: Joined, submap: Submap) -> float:
        looks.alone += 1
        return excess_alone(log.tables, joined, submap)

    def together(joined: Joined, submap: Submap) -> float:
        looks.together += 1
        return excess_together(log.tables, joined, submap)

    basins.lowest(choices, solve, alone, together)
    others = sum(map(len, choices)) - len(choices)
    assert others >= 2 * robots
    assert (looks.solves, looks.alone) == (1, others)
    assert looks.together <= basins.MOST


@pytest.mark.parametrize("way", ["full", "exact"])
def test_searches_grow_in_proportion_to_the_log(way: str, counter: Counter) -> None:
    """Each robot has several ways to start from: looks at one of them alone are one robot's work, and those at the
    whole are bounded."""
    used = {}
    for robots in (4, 8, 16):
        log, before = rows_of_robots(robots), counter.factorisations
        _ = full(log) if way == "full" else exact_join(split(log))
        used[robots] = counter.factorisations - before
    assert used[16] <= 2.5 * used[8] <= 2.5 * 2.5 * used[4]


@pytest.mark.parametrize("world", WORLDS)
def test_where_there_is_one_way_nothing_is_searched(world: str) -> None:
    pieces = split(team(world))
    choices = [build_choices(piece) for piece in pieces]
    assert [len(of) for of in choices] == [1] * len(choices)
    solves: list[Sequence[Submap]] = []

    def solve(submaps: Sequence[Submap]) -> Joined:
        solves.append(submaps)
        return join(submaps)

    def never(joined: Joined, submap: Submap) -> float:
        raise AssertionError("there is nothing to look at")

    basins.lowest(choices, solve, never, never)
    assert len(solves) == 1
