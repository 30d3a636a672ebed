"""The checks of the stress test can fail: lies are found, and what is true is not called one."""

from dataclasses import replace

import numpy as np
import pytest

from stress.claims import check_sentences
from stress.drive import DRIVES, Outcome, go
from stress.failure import Findings
from stress.maps import check_maps
from stress.oracle import Oracle, jacobian
from stress.scenario import Scenario, draw
from stress.truth import check_truth
from stress.verdict import heard, judge, rows_in, told
from stress.whole import check_whole
from stress.world import chosen, log_of
from teamslam.errors import SolveError
from teamslam.geometry import Pose, concatenate
from teamslam.joining import Joined
from teamslam.model import Dataset, Kind, Submap, Table, Values, landmark_key, pack, pose_key
from worlds import WORLDS, team


def mapped(log: Dataset, drive: str = "full") -> Outcome:
    outcome = go(log, DRIVES[drive])
    assert outcome.joined is not None
    return outcome


def kinds(findings: Findings) -> set[str]:
    return {failure.kind for failure in findings.failures}


def of_maps(outcome: Outcome, *, fair: bool = True) -> set[str]:
    findings = Findings()
    check_maps(outcome, findings, fair=fair)
    check_whole(outcome, findings)
    return kinds(findings)


def of_sentences(outcome: Outcome) -> set[str]:
    findings = Findings()
    check_sentences(outcome, Oracle(outcome.log), findings)
    return kinds(findings)


def with_map(outcome: Outcome, **changes: object) -> Outcome:
    """The outcome with its first map changed."""
    assert outcome.joined is not None
    first = outcome.joined.components[0]
    changed = replace(first, map=replace(first.map, **changes))
    return replace(outcome, joined=replace(outcome.joined, components=(changed, *outcome.joined.components[1:])))


# --- logs ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(30))
def test_a_seed_is_a_log(seed: int) -> None:
    scenario = draw(seed)
    assert isinstance(scenario, Scenario) and str(scenario) == str(draw(seed))
    one, other = log_of(scenario), log_of(scenario)
    for a, b in zip(one.tables, other.tables, strict=True):
        np.testing.assert_array_equal(a.values, b.values)
    rows = rows_in(one)
    assert heard(told(rows)) == rows
    assert rows_in(chosen(one, rows)) == rows


# --- the oracle ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("world", WORLDS)
def test_the_jacobian_is_that_of_the_residuals(world: str) -> None:
    oracle = Oracle(team(world, robots=2, poses=4))
    step = np.random.default_rng(0).standard_normal(oracle.truth.layout.dof)

    def residuals(share: float) -> np.ndarray:
        return np.concatenate([t.residual(oracle.truth.retract(share * step)).ravel() for t in oracle.tables])

    slope = (residuals(1e-6) - residuals(-1e-6)) / 2e-6
    np.testing.assert_allclose(jacobian(oracle.tables, oracle.truth) @ step, slope, atol=1e-6)


def test_the_jacobian_knows_levers_of_a_micron() -> None:
    """A heading of which nothing tells but a step of half a micron, that is known to a micron."""
    keys, away = np.array([[pose_key(1, 0), pose_key(1, 1)]]), 5e-7
    seen, start = Pose.from_xytheta(np.array([[away, 0.0, 0.0]])), Pose.from_xytheta(np.array([[5.0, -7.0, 0.4]]))
    sure = np.diag([1e6, 1e6, 1e-2])[None]
    step = Table(1, "odometry", "relative_pose", 2, keys, pack(seen), sure, np.arange(1))
    turn = jacobian([step], Values.of({Kind.POSE2: (keys[0], concatenate([start, start @ seen]))}))[:2, 2]
    assert float(np.linalg.norm(turn)) == pytest.approx(away, rel=1e-4)


def test_what_is_open_is_counted() -> None:
    log = team("2d", robots=2, poses=6, landmarks=1, sees=1.0)
    alone = log.with_tables(t for t in log.tables if t.source != "robots")
    frames = int(pose_key(1, 0)), int(pose_key(2, 0))
    assert Oracle(log).freedom(Oracle(log).between(*frames)) == 0
    assert Oracle(alone).freedom(Oracle(alone).between(*frames)) == 1  # about the landmark
    apart = alone.with_tables(t for t in alone.tables if t.source != "landmarks")
    assert Oracle(apart).freedom(Oracle(apart).between(*frames)) == 3


def test_sigmas_are_those_of_dead_reckoning() -> None:
    log = team("2d", robots=1, poses=5, landmarks=0, sigma_odometry=0.02)
    sigmas = Oracle(log).sigmas(Oracle(log).between(int(pose_key(1, 0)), int(pose_key(1, 4))))
    assert sigmas[2] == pytest.approx(0.04, rel=1e-6)  # four steps


# --- maps that are wrong --------------------------------------------------------------------------------------------


def test_a_sound_map_passes() -> None:
    assert not of_maps(mapped(team(robots=2, poses=5)))


def test_a_map_beside_its_optimum_is_found() -> None:
    outcome = mapped(team(robots=2, poses=5))
    values = outcome.components[0].map.values
    moved = values.retract(0.01 * np.ones(values.layout.dof))
    assert {"a converged map is at an optimum", "cost is that of the rows"} <= of_maps(with_map(outcome, values=moved))


def test_too_much_confidence_is_found() -> None:
    outcome = mapped(team(robots=2, poses=5))
    sure = with_map(outcome, information=100.0 * outcome.components[0].map.information)
    assert {"information is that of the rows", "a map's errors are those that it expects"} <= of_maps(sure)


def test_numbers_that_are_none_are_found() -> None:
    outcome = mapped(team(robots=2, poses=5))
    values = outcome.components[0].map.values
    broken = replace(values, state=np.where(np.arange(len(values.state)) == 3, np.nan, values.state))
    assert "a map's numbers are finite" in of_maps(with_map(outcome, values=broken))


def test_what_vanished_is_found() -> None:
    log = team(robots=2, poses=5, landmarks=3, sees=1.0)
    outcome = mapped(log)
    blind = mapped(log.with_tables(_without(t, int(landmark_key(1))) for t in log.tables))
    found = of_maps(replace(outcome, joined=blind.joined), fair=False)
    assert {"every landmark comes out", "every row comes out"} <= found
    alone = mapped(log.with_tables(t for t in log.tables if t.robot == 1 and t.source != "robots"))
    assert "every robot comes out" in of_maps(replace(outcome, joined=alone.joined), fair=False)


def _without(table: Table, key: int) -> Table:
    return table.select((table.keys != key).all(1))


@pytest.mark.parametrize("drive", ["full", "exact", "join"])
@pytest.mark.parametrize("world", WORLDS)
def test_a_map_that_ends_in_the_wrong_basin_is_found(world: str, drive: str) -> None:
    """It says that it has converged, and a search from the truth ends far lower."""
    outcome = mapped(team(world, robots=2, poses=6, landmarks=4, sees=1.0), drive)
    assert not of_truth(outcome)
    assert outcome.joined is not None
    values = outcome.joined.components[0].map.values
    astray = with_map(outcome, values=values.retract(0.5 * np.random.default_rng(1).normal(size=values.layout.dof)))
    assert of_truth(astray) == {"no map costs more than the optimum from the truth"}


@pytest.mark.parametrize("seed", [11000010, 13000057], ids=["at two places", "on either side of a plane"])
def test_another_optimum_is_named_where_remarks_tell_of_it_and_of_no_other(seed: int) -> None:
    outcome = go(log_of(draw(seed)), DRIVES["full"])
    assert outcome.joined is not None and len(outcome.joined.remarks)
    said = "another optimum that fits as well is named"
    assert said not in of_maps(outcome)
    for lie in ((), (outcome.joined.remarks[0].replace("landmark", "tower"),)):
        assert said in of_maps(replace(outcome, joined=replace(outcome.joined, remarks=lie)))


def of_truth(outcome: Outcome) -> set[str]:
    findings = Findings()
    check_truth(outcome, findings)
    assert sum(findings.held.values()) + len(findings.failures) == 1
    return kinds(findings)


# --- sentences that are false -------------------------------------------------------------------------------------


def split_in_two(log: Dataset, reason: str) -> Outcome:
    """A map of two robots told as two, with a reason."""
    parts = [mapped(log.of_robot(robot), "join").components[0] for robot in (1, 2)]
    return Outcome(log, "join", Joined(tuple(parts), (reason,)))


REASON = (
    "the submaps of robot 2 from robot 2 at pose 0 on share {} with the map{}; two common landmarks, or one sighting "
    "of a robot's pose, would join them"
)
NOTHING = REASON.format("nothing", ": no common landmark, and neither robot saw the other")
COULD = (
    "the submaps of robot 2 from robot 2 at pose 0 on are tied to the map by landmark 0, which could hold their frame, "
    "but no place was found where they fit and do"
)
TURNS = REASON.format("only landmark 0", " and can still turn about it: under-constrained, 1 direction free")


def test_lies_about_what_is_shared_are_found() -> None:
    log = team("2d", robots=2, poses=6, landmarks=3, sees=1.0)
    own = log.with_tables(t for t in log.tables if t.source == "landmarks" or t.source == "odometry")
    assert of_sentences(split_in_two(own, NOTHING)) == {"true: shares nothing"}
    assert of_sentences(split_in_two(own, TURNS)) == {"true: can still turn"}
    apart = log.with_tables(t for t in log.tables if t.source == "odometry")
    assert not of_sentences(split_in_two(apart, NOTHING))
    hinge = team("2d", robots=2, poses=6, landmarks=1, sees=1.0)
    hinge = hinge.with_tables(t for t in hinge.tables if t.source != "robots")
    assert not of_sentences(split_in_two(hinge, TURNS))
    assert of_sentences(split_in_two(hinge, COULD)) == {"true: no place was found"}
    assert not of_sentences(split_in_two(own, COULD))


def test_lies_about_what_is_determined_are_found() -> None:
    log = team("2d", robots=1, poses=6, landmarks=1, sees=1.0)
    lie = SolveError("landmark 0 is not determined by the measurements: too few sightings")
    assert of_sentences(Outcome(log, "join", error=lie)) == {"true: not determined"}
    bearing = team("2d", robots=1, poses=6, landmarks=1, sees=1.0, model="bearing")
    once = bearing.with_tables(t if t.source == "odometry" else t.select(np.arange(1)) for t in bearing.tables)
    assert not of_sentences(Outcome(once, "join", error=lie))
    rounding = SolveError("landmark 0 is not determined, to within rounding: the information matrix has no pivot")
    assert of_sentences(Outcome(log, "join", error=rounding)) == {"true: not determined, to within rounding"}
    assert not of_sentences(Outcome(once, "join", error=rounding))


def test_a_sentence_that_nobody_can_check_is_found() -> None:
    log = team("2d", robots=1, poses=3)
    (kind,) = of_sentences(Outcome(log, "join", error=SolveError("something went wrong")))
    assert kind.startswith("a sentence that cannot be checked")


def test_a_verdict_is_repeatable() -> None:
    one, other = judge(7), judge(7)
    assert one.findings.held == other.findings.held
    submaps = [[c.map for c in v.outcome.components] for v in (one, other)]
    for a, b in zip(*submaps, strict=True):
        assert isinstance(a, Submap)
        np.testing.assert_array_equal(a.values.state, b.values.state)
