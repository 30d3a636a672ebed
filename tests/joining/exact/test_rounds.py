"""The law of exact joining: its estimate is that of the full least squares, which finds it from elsewhere."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from strategies import seeds
from stress.scenario import draw
from stress.world import log_of
from teamslam.errors import SolveError
from teamslam.geometry import Pose
from teamslam.joining import Joined, build_choices, exact_join, full, join, split
from teamslam.joining.build.build import build
from teamslam.joining.exact.robot import Part, Reduced, Sending
from teamslam.model import SQUARED, Dataset, Loss, Table, Values, pack, pose_key
from teamslam.solver import Options, Status
from teamslam.solver.newton import Curvature
from worlds import WORLDS, mixed_team, team

TO_ROUNDING = Options(decrement=1e-12, cost_share=0.0)

TEAMS = {
    **{world: lambda world=world: team(world, sigma=0.05, sigma_odometry=0.05) for world in WORLDS},
    "mixed": mixed_team,
    "ranges": lambda: team("2d", robot_model="range", sigma=0.1, sigma_odometry=0.05),
    "ranges in space": lambda: team("3d", robot_model="range", sigma=0.1, sigma_odometry=0.05),
    "robust": lambda: team("planar", sigma=0.05, sigma_odometry=0.05).with_loss(Loss("cauchy", 1.0)),
}


def perturbed(joined: Joined, sigma: float, seed: int) -> Joined:
    """The same map, every unknown moved at random [m, rad]."""
    rng = np.random.default_rng(seed)
    components = []
    for component in joined.components:
        values = component.map.values
        moved = values.retract(sigma * rng.standard_normal(values.layout.dof))
        components.append(replace(component, map=replace(component.map, values=moved)))
    return replace(joined, components=tuple(components))


def assert_equal(exact: Joined, found: Joined) -> None:
    """Costs to 1e-10 of them, estimates to 1e-8 m and rad."""
    assert exact.converged and found.converged
    assert len(exact.components) == len(found.components)
    for mine, other in zip(exact.components, found.components, strict=True):
        assert abs(mine.map.cost - other.map.cost) <= 1e-10 * other.map.cost
        np.testing.assert_allclose(mine.map.values.minus(other.map.values), 0.0, atol=1e-8)
        assert mine.exactness is not None and mine.exactness.relative_cost_gap <= 1e-10


def assert_law(dataset: Dataset, sigma: float = 0.01) -> None:
    """Exact joining against full least squares from the paper's join, and from that join perturbed."""
    exact = exact_join(split(dataset))
    start = join([build(piece) for piece in split(dataset)])
    assert_equal(exact, full(dataset, initial=start, options=TO_ROUNDING))
    assert_equal(exact, full(dataset, initial=perturbed(start, sigma, 1), options=TO_ROUNDING))


@pytest.mark.parametrize("which", TEAMS)
def test_exact_joining_finds_what_full_least_squares_finds(which: str) -> None:
    assert_law(TEAMS[which]())


def test_large_residuals_that_bend_need_few_rounds() -> None:
    """Gauss-Newton alone leaves most of the distance with each round; with what residuals bend, rounds are Newton's."""
    dataset = team("2d", robot_model="range", sigma=0.8, sigma_odometry=0.05, every=1, sees=0.2, seed=5)
    report = exact_join(split(dataset)).components[0].exactness
    assert report is not None and report.gradient_norm < 1e-9
    assert report.rounds <= 12


@pytest.mark.parametrize("world", WORLDS)
def test_a_robot_alone_that_fits_exactly_needs_no_rounds_to_say_so(world: str) -> None:
    """Its cost is zero but for rounding, of which no share is left to gain."""
    dataset = team(world, robots=1)
    odometry = dataset.with_tables(t for t in dataset.tables if t.source == "odometry")
    exact = exact_join(split(odometry))
    report = exact.components[0].exactness
    assert exact.converged and report is not None and report.rounds <= 5


@pytest.mark.parametrize("world", WORLDS)
def test_a_small_share_of_a_step_goes_down_as_its_slope_says(world: str) -> None:
    """Interiors that are far from their rest go the same share as the separators: F falls by 2 share g'd."""
    (piece,) = split(team(world, robots=1, poses=12, landmarks=6))
    submap = build(piece)
    part = Part.of(piece, submap, Sending.of(submap, submap.values.layout.keys[-2:]))
    assert not part.sends_whole
    part.values = part.system.retract(part.values, np.random.default_rng(3).normal(0.0, 0.02, part.system.free.dof))
    sent = part.reduce()
    step = np.linalg.solve(sent.information.toarray(), sent.slope)
    decrease = float(sent.slope @ step) + sent.interior
    for share in (1e-3, 1e-5):
        there = part.system.cost(part.follow(part.separators.retract(share * step), share))
        assert sent.cost - there == pytest.approx(2.0 * share * decrease, rel=0.05)
    still = part.follow(part.separators, 0.0)
    np.testing.assert_allclose(still.minus(part.values), 0.0, atol=1e-14)


@pytest.mark.slow
def test_stiff_steps_with_headings_that_are_open_go_down_to_the_optimum() -> None:
    """Places between which lengths are known to 10 um and headings not at all: the paper's join lies 1e5 sigma off."""
    rng = np.random.default_rng(0)
    keys, n = pose_key(1, np.arange(8)), 8
    way = Pose.from_xytheta(np.stack([np.arange(n), np.zeros(n), np.zeros(n)], -1) + rng.normal(0.0, 0.3, (n, 3)))
    steps = way[:-1].between(way[1:]).retract(rng.normal(0.0, 1.0, (n - 1, 3)) * [1e-5, 1e-5, 3.0])
    weights = np.diag([1e5, 1e5, 0.3])[None]
    seen = np.arange(0, n, 3)
    places = way.translation[seen] + rng.normal(0.0, 3.0, (len(seen), 2))
    links = np.stack([keys[:-1], keys[1:]], -1)
    tables = [
        Table(1, "odometry", "relative_pose", 2, links, pack(steps), weights, np.arange(n - 1)),
        Table(1, "world", "position", 2, keys[seen, None], places, np.eye(2)[None] / 3.0, np.arange(len(seen))),
    ]
    log = Dataset({1: 2}, tuple(tables))
    (component,), (least,) = exact_join(split(log)).components, full(log).components
    assert component.exactness is not None and component.exactness.gradient_norm < 1e-2
    assert component.map.cost == pytest.approx(least.map.cost, rel=1e-4)


@pytest.mark.parametrize("which", ["steps that are halved", "many separators"])
def test_every_number_sent_is_counted(which: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Counted where it is sent: by every robot in every round, and for every step and part of a step that is tried."""
    up, down = [], []
    reduce, follow = Part.reduce, Part.follow

    def reducing(part: Part, curvature: Curvature = "none") -> Reduced:
        sent = reduce(part, curvature)
        scalars = 1 if part.sends_whole else 2  # its cost, and what its interiors have to gain
        up.append(sp.triu(sent.information).nnz + len(sent.slope) + scalars)
        return sent

    def following(part: Part, separators: Values, share: float) -> Values:
        down.append(len(separators.state) + 1)
        return follow(part, separators, share)

    monkeypatch.setattr(Part, "reduce", reducing)
    monkeypatch.setattr(Part, "follow", following)
    halved = team("2d", robot_model="range", sigma=1.5, sigma_odometry=0.2, every=1, sees=0.2, seed=3)
    dataset = halved if which == "steps that are halved" else team("planar", poses=60)
    component = exact_join(split(dataset)).components[0]
    robots, report, solution = len(dataset.robots), component.exactness, component.solution
    assert report is not None and solution is not None
    assert report.rounds == len(up) / robots > solution.iterations
    costs = len(down) - robots  # one comes back from every place but the join's
    assert report.bytes == 8 * (sum(up) + sum(down) + costs)
    if which == "steps that are halved":
        assert costs > robots * solution.iterations


def test_a_robot_alone_sends_nothing() -> None:
    report = exact_join(split(team("planar", robots=1))).components[0].exactness
    assert report is not None and report.bytes == 0 and report.join_shift_sigma > 0.0


def test_submaps_that_are_built_already_are_not_built_again() -> None:
    """Exact joining takes them as they are, and comes to the same map as from the pieces alone."""
    pieces = split(team("planar", sigma=0.05, sigma_odometry=0.05))
    choices = [build_choices(piece) for piece in pieces]
    given, alone = exact_join(pieces, choices=choices), exact_join(pieces)
    assert given.map.values.state.tobytes() == alone.map.values.state.tobytes()
    elsewhere = exact_join(pieces, choices=[[replace(s, id=f"my {s.id}") for s in found] for found in choices])
    assert all(member.startswith("my ") for member in elsewhere.components[0].members)


@settings(max_examples=12)
@given(seeds, st.sampled_from(WORLDS))
def test_curvature_that_leads_nowhere_stops_no_rounds(seed: int, world: str) -> None:
    """Under losses that forgive, far from an optimum, a step by how residuals bend may go up however short it is: the
    rounds go on without, and none says that no step goes down."""
    rng = np.random.default_rng(seed)
    log, tables = team(world, robots=2, poses=3, landmarks=2, sees=0.5, every=2, sigma=0.1, sigma_odometry=0.1), []
    for table in log.tables:
        values = table.values.copy()
        if table.source != "odometry":
            wrong = rng.random(len(table)) < 0.3
            values[wrong, :2] += rng.normal(size=(int(wrong.sum()), 2))
        forgiving = Loss(str(rng.choice(["geman_mcclure", "cauchy", "huber"])), 0.5)
        tables.append(replace(table, values=values).with_loss(SQUARED if table.source == "odometry" else forgiving))
    try:
        joined = exact_join(split(log.with_tables(tables)))
    except SolveError:
        return  # next to nothing was seen, and what was a loss forgives
    assert all(c.solution is None or c.solution.status is not Status.STUCK for c in joined.components)


def test_where_no_shortened_step_goes_down_the_rows_that_are_all_at_hand_lead_on() -> None:
    """Ranges of 0.1 mm beside odometry of 36 m: a valley so narrow that rounds alone end at 20 times the cost. Which of
    the optima in it is met rounding decides, on each machine anew: they are within a hundredth of each other."""
    log = log_of(draw(11000185))
    alone = replace(log, tables=tuple(table for table in log.tables if table.robot == 2), truth=None)
    exact, found = exact_join(split(alone)), full(alone)
    assert exact.converged and found.converged
    (one,), (other,) = ([c.solution.cost for c in joined.components if c.solution] for joined in (exact, found))
    assert one == pytest.approx(other, rel=0.01)
