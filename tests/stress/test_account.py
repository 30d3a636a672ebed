"""What a map says of what it left out is checked: lies are found, and what is true is not called one."""

from dataclasses import replace

import numpy as np
import pytest

from joining.join.test_gauge import surveyed
from stress.account import check_account
from stress.drive import DRIVES, Outcome, go
from stress.failure import Findings
from stress.near import check_near
from stress.oracle import Oracle
from teamslam.joining import Joined
from teamslam.model import Dataset, LeftOut, Sources, Table, is_landmark, landmark_key
from worlds import team


def mapped(log: Dataset) -> Outcome:
    outcome = go(log, DRIVES["join"])
    assert outcome.joined is not None
    return outcome


def saying(outcome: Outcome, *lost: LeftOut, remarks: tuple[str, ...] = ()) -> set[str]:
    """What is found in a map that says it left something out."""
    assert outcome.joined is not None
    said = replace(outcome, joined=replace(outcome.joined, left_out=lost, remarks=remarks))
    return kinds(said)


def kinds(outcome: Outcome) -> set[str]:
    findings = Findings()
    check_account(outcome, Oracle(outcome.log), findings)
    return {failure.kind for failure in findings.failures}


def seen_once(log: Dataset, key: int) -> Dataset:
    """The log with one sighting of a landmark, that of robot 1."""

    def keep(table: Table) -> Table:
        mask = (table.keys != key).all(1)
        if table.robot == 1 and not mask.all():
            mask[np.flatnonzero(~mask)[0]] = True
        return table.select(mask)

    return replace(log, tables=tuple(keep(t) for t in log.tables))


BEARINGS = {"world": "2d", "robots": 2, "poses": 6, "landmarks": 4, "sees": 1.0, "model": "bearing"}


def test_a_landmark_that_is_open_is_left_out_with_a_true_reason() -> None:
    outcome = mapped(seen_once(team(**BEARINGS), int(landmark_key(1))))
    assert outcome.joined is not None and [lost.kind for lost in outcome.joined.left_out] == ["landmark"]
    assert not kinds(outcome)


def test_a_landmark_that_its_rows_fix_may_not_be_left_out() -> None:
    log = team(**BEARINGS)
    rows = [t.select((t.keys == int(landmark_key(1))).any(1)) for t in log.tables]
    key, count = landmark_key(np.array([1])), sum(map(len, rows))
    sources = Sources.of([t for t in rows if len(t)])
    lost = LeftOut("landmark", "landmark 1", key, sources, count, f"{count} bearings: rays that are nearly parallel")
    assert saying(mapped(log), lost) == {"left out: a landmark that its rows leave open"}
    unseen = replace(lost, reason="no pose that saw it is in a map (12 bearings)")
    assert saying(mapped(log), unseen) == {"left out: a landmark that no mapped pose saw"}
    miscounted = replace(lost, count=count + 1)
    assert "left out: as many rows as are counted" in saying(mapped(log), miscounted)


def test_a_piece_that_its_rows_fix_may_not_be_left_out() -> None:
    log = team("2d", robots=2, poses=6)
    rows = [t for t in log.tables if t.robot == 2]
    reason = "robot 2 at pose 3 is not determined by the measurements: the information matrix has no positive pivot"
    lost = LeftOut("piece", "robot 2", log.pose_keys[2], Sources.of(rows), sum(map(len, rows)), reason)
    assert saying(mapped(log), lost) == {"left out: a piece, true: not determined"}
    alone = replace(lost, reason="robot 2 at pose 3 stands alone: no odometry leads to it or from it")
    assert saying(mapped(log), alone) == {"left out: a piece, true: stands alone"}


@pytest.mark.parametrize("source", ["odometry", "landmarks"])
def test_rows_that_one_map_could_hold_may_not_be_left_out(source: str) -> None:
    log = team("2d", robots=2, poses=6, landmarks=3, sees=1.0)
    rows = [t for t in log.tables if t.source == source and t.robot == 1]
    lost = LeftOut("rows", source, np.zeros(0, np.int64), Sources.of(rows), sum(map(len, rows)), "they tie together")
    assert saying(mapped(log), lost) == {"left out: rows that no one map could hold"}


@pytest.mark.parametrize(("every", "true"), [(100, True), (2, False)])
def test_rows_of_the_world_are_left_out_where_they_leave_the_map_free_to_turn(every: int, true: bool) -> None:
    """One position does; those of every other pose hold it, and a map without them says what is not so."""
    log = surveyed(team("2d", robots=2, poses=6, landmarks=3, sees=1.0), every)
    rows = [t for t in log.tables if t.row.unary]
    lost = LeftOut("rows", "world", np.zeros(0, np.int64), Sources.of(rows), sum(map(len, rows)), "free to turn")
    bare = log.with_tables(t for t in log.tables if not t.row.unary)
    outcome = replace(mapped(bare), log=log)
    assert saying(outcome, lost) == (set() if true else {"left out: rows of a world that a map is free to turn in"})


def test_rows_of_the_world_are_judged_by_the_map_that_they_are_of() -> None:
    """A map apart from one that is held in the world, though they share landmarks: it is free to turn about its one
    position."""
    log = team("2d", robots=2, poses=6, landmarks=3, sees=1.0)
    log = log.with_tables(t for t in log.tables if t.source != "robots")
    log = surveyed(surveyed(log, 2), 100, (2,))
    first, second = (mapped(log.with_tables(t for t in log.tables if t.robot == robot)) for robot in (1, 2))
    lost = second.joined.left_out
    assert [entry.kind for entry in lost] == ["rows"]
    both = replace(first, log=log, joined=Joined((*first.components, *second.components), left_out=lost))
    assert not kinds(both)


def test_remarks_are_true() -> None:
    outcome = mapped(team("2d", robots=2, poses=4))
    idle = "robot 2 measured nothing, and nobody saw it: it is in no map"
    assert saying(outcome, remarks=(idle,)) == {"remark: a robot that no row speaks of"}
    near = "submap 2/0 stopped {} sigma from its optimum, and is used as it is"
    assert not saying(outcome, remarks=(near.format("0.0003"),))
    assert saying(outcome, remarks=(near.format("3"),)) == {"remark: a submap that is nearly at its optimum"}
    assert saying(outcome, remarks=("all is well",)) == {"a remark that cannot be checked"}


def test_a_map_far_from_the_truth_is_found() -> None:
    log = team("2d", robots=1, poses=12, landmarks=6, sees=1.0)
    outcome = mapped(log)
    findings = Findings()
    check_near(outcome, findings)
    assert not findings.failures and findings.held["a map is near the truth"] == 1
    (component,) = outcome.components
    values = component.map.values
    state = values.state.copy()
    marks = np.flatnonzero(is_landmark(values.layout.keys))
    state[values.layout.state_start[marks[0]]] += 5.0
    moved = replace(component, map=replace(component.map, values=replace(values, state=state)))
    lied = replace(outcome, joined=Joined((moved,)))
    check_near(lied, findings)
    assert [failure.kind for failure in findings.failures] == ["a map far from the truth says why"]
