"""What a map says of what is not in it, and of what is in it though something is to be known: each reason is true."""

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from stress.claims import BEYOND, WEAK_PLACE, at_odds, is_true, moves_in_the_world, weak
from stress.drive import Outcome
from stress.failure import Findings
from stress.maps import rows_of
from stress.oracle import Oracle, TooLarge, jacobian, spoken_of
from stress.places import fits_there, rays_meet
from teamslam.geometry import Array
from teamslam.joining import Component
from teamslam.model import WORLD, Dataset, LeftOut, Table, is_pose, robot_of

IN_LINE = 0.2  # of their spread along it: places so near a line that ranges from them may leave the side open
LITTLE = 0.1  # [sigmas]: a submap that stopped farther from its optimum is not to be used


def check_account(outcome: Outcome, oracle: Oracle, findings: Findings) -> None:
    """All entries of `left_out`, and all remarks."""
    if outcome.joined is None:
        return
    for lost in outcome.joined.left_out:
        rows = list(_rows_of(lost, outcome.log))
        findings.check("left out: as many rows as are counted", sum(map(len, rows)) == lost.count, lost)
        try:
            _KINDS[lost.kind](lost, rows, outcome, oracle, findings)
        except TooLarge:
            findings.unchecked[f"left out: {lost.kind}"] += 1
    for remark in outcome.joined.remarks:
        _remark(remark, outcome, oracle, findings)


def _rows_of(lost: LeftOut, log: Dataset) -> list[Table]:
    tables = []
    for table in log.tables:
        keep = np.zeros(len(table), bool)
        for s in lost.rows:
            if (s.robot, s.source) == (table.robot, table.source):
                keep |= (table.ids >= s.start) & (table.ids < s.stop)
        tables += [table.select(keep)] if keep.any() else []
    return tables


def _piece(lost: LeftOut, rows: list[Table], outcome: Outcome, oracle: Oracle, findings: Findings) -> None:
    """The reason is what `build` said of these rows; of a lone pose also why no map has a place for it."""
    before, alone, after = lost.reason.rpartition(" stands alone: ")
    apart, _, who = before.rpartition("; ")
    own = replace(outcome.log, tables=tuple(rows))
    is_true(who + alone + after, "left out: a piece", replace(outcome, log=own), Oracle(own), findings)
    if apart:
        is_true(apart, "left out: a piece", outcome, oracle, findings)


def _landmark(lost: LeftOut, rows: list[Table], outcome: Outcome, oracle: Oracle, findings: Findings) -> None:
    """Nobody in a map saw it; or whoever did leaves it open, or on either side."""
    (key,) = (int(k) for k in lost.keys)
    seers = [int(k) for k in spoken_of(rows) if is_pose(int(k))]
    mapped: set[int] = set().union(*(_keys_in(c) for c in outcome.components))
    what = "left out: a landmark that its rows leave open"
    if "went with what is left out" in lost.reason:
        findings.check("left out: a landmark whose rows went elsewhere", not rows, lost)
    elif "no pose that saw it is in a map" in lost.reason:
        findings.check("left out: a landmark that no mapped pose saw", mapped.isdisjoint(seers), lost)
    elif "solving for it together with the map fails" in lost.reason:
        findings.check("left out: a landmark with which no solve ends", at_odds(oracle, rows), lost)
    elif "on which side of the sensor nearest" in lost.reason:
        near = any(_nearer_than_known(oracle, seer, key) for seer in seers)
        findings.check("left out: a landmark nearer to a sensor than it is known", near, f"{lost.what}: {lost.reason}")
    elif "free to shift or turn in the world" in lost.reason:
        findings.check("left out: a landmark of a world that maps are free to turn in", _free(outcome, oracle), lost)
    elif "no place fits these rays" in lost.reason:
        by = [c.map for c in outcome.components if not _keys_in(c).isdisjoint(seers)]
        skew = bool(by) and not any(rays_meet(whole, key, rows) for whole in by)
        findings.check("left out: a landmark whose rays do not meet", skew, f"{lost.what}: {lost.reason}")
    elif "how the poses that saw it lie to each other" in lost.reason:
        pairs = [(one, other) for one in seers for other in [*seers, key] if one != other]
        loose = any(weak(oracle, *pair) for pair in pairs)
        findings.check(
            "left out: a landmark that was seen from poses known badly", loose, f"{lost.what}: {lost.reason}"
        )
    elif "maps, in each of which" in lost.reason:
        open_ = all(_open_in(c, key, rows, outcome) for c in outcome.components)
        findings.check(what + " in each map", open_, f"{lost.what}: {lost.reason}")
    elif not seers:  # surveyed alone
        findings.check(what, weak_alone(oracle, key), lost.reason)
    else:
        open_ = all(weak(oracle, seer, key) for seer in seers) or _in_line(oracle, seers, rows)
        findings.check(what, open_, f"{lost.what}: {lost.reason}")


def _keys_in(component: Component) -> set[int]:
    return set(component.map.keys.tolist())


def _open_in(component: Component, key: int, rows: list[Table], outcome: Outcome) -> bool:
    """Whether a landmark is open, or on either side, by what one map's rows and its own from there tell."""
    inside = list(_keys_in(component))
    own = [t.select(np.isin(t.keys[:, 0], inside)) for t in rows]
    seers = [int(k) for k in spoken_of(own) if is_pose(int(k))]
    oracle = Oracle(outcome.log.with_tables([*rows_of(component.map, outcome.log), *(t for t in own if len(t))]))
    return all(weak(oracle, seer, key) for seer in seers) or _in_line(oracle, seers, own)


def _free(outcome: Outcome, oracle: Oracle) -> bool:
    """Whether each map is written in a robot's frame, and free to shift or turn in the world."""
    poses = (np.min(m.keys[is_pose(m.keys) & (robot_of(m.keys) > 0)]) for m in (c.map for c in outcome.components))
    if any(c.map.base == WORLD for c in outcome.components):
        return False
    return all(moves_in_the_world(oracle, int(pose)) for pose in poses)


def weak_alone(oracle: Oracle, key: int) -> bool:
    """Whether a landmark's own place in the world is open."""
    unknowns = oracle.truth.layout.unknowns(np.array([key]))
    relation: Array = np.zeros((len(unknowns), oracle.truth.layout.dof))
    relation[np.arange(len(unknowns)), unknowns] = 1.0
    return oracle.freedom(relation) > 0


def _nearer_than_known(oracle: Oracle, seer: int, key: int) -> bool:
    """Whether how well a landmark is known from a pose is a good share of how far it truly is from there."""
    ends = oracle.truth.positions(np.array([seer, key]), 3)
    relation = oracle.between(seer, key)
    away = float(np.linalg.norm(ends[1] - ends[0]))
    return bool(oracle.freedom(relation) or (oracle.sigmas(relation) > WEAK_PLACE * away).any())


def _in_line(oracle: Oracle, seers: list[int], rows: list[Table]) -> bool:
    """Ranges, or rows with a loss that forgives, from places nearly in a line (a plane in space): two sides fit."""
    if any(t.model not in ("range", "bearing") for t in rows):
        return False
    places = oracle.truth.positions(np.array(seers), 3)
    spread = np.linalg.svd(places - places.mean(0), compute_uv=False)
    flat = 2 if not (oracle.truth.layout.kinds % 2).any() else 3
    return len(places) < flat + 1 or bool(spread[flat - 1] <= IN_LINE * max(spread[0], 1e-9))


def _poses(lost: LeftOut, rows: list[Table], outcome: Outcome, oracle: Oracle, findings: Findings) -> None:
    """Seen from every pose beside it, each is open or weak, or no row speaks of it together with what is mapped."""
    mapped = {int(k) for c in outcome.components for k in c.map.keys}
    for key in lost.keys.tolist():
        tables = [t.select((t.keys == key).any(1)) for t in outcome.log.tables]
        around = [int(k) for k in spoken_of(tables) if k != key and int(k) in mapped]
        if "no place was found" in lost.reason:
            findings.check("left out: poses whose sightings fix a place", fixes_a_place(outcome.log, key), lost.reason)
            continue
        if "no odometry leads there" in lost.reason:  # seen from where others saw what was seen from there
            rows_on = [t.select(np.isin(t.keys, around).any(1)) for t in outcome.log.tables]
            around = [int(k) for k in spoken_of(rows_on) if is_pose(int(k)) and int(k) in mapped][:1]
        open_ = all(weak(oracle, *_observer(one, key)) for one in around)
        if "what was seen from there" in lost.reason:
            open_ |= not fixes_a_place(outcome.log, key)
        if "a loss forgives" in lost.reason:
            whole = [t for t in tables if t.model == "relative_pose" and len(t)]
            open_ |= all(t.loss.name != "squared" and t.robot != robot_of(np.int64(key)) for t in whole)
        findings.check("left out: poses that rows leave open", open_, f"{lost.what}: {lost.reason}")


def fixes_a_place(log: Dataset, pose: int) -> bool:
    """Whether what was seen from a pose leaves it nowhere to go where what it sees stands still: by the Jacobian of its
    rows, the pose alone moved."""
    oracle = Oracle(log.with_tables(t.select((t.keys == pose).any(1)) for t in log.tables))
    own = oracle.truth.layout.unknowns(np.array([pose]))
    moved = jacobian(oracle.tables, oracle.truth)[:, own]
    return bool(np.linalg.matrix_rank(moved, tol=1e-6) == len(own))


def _observer(one: int, key: int) -> tuple[int, int]:
    """Who sees whom: frames are poses."""
    return (one, key) if is_pose(one) else (key, one)


def _loose_rows(lost: LeftOut, rows: list[Table], outcome: Outcome, oracle: Oracle, findings: Findings) -> None:
    """None of them speaks of one map's variables alone; or they are of the world, in which that map is free to turn by
    its own rows and these."""
    if all(t.row.unary for t in rows):
        keys = spoken_of(rows)
        for component in outcome.components:
            poses = component.map.all_values.layout.keys
            poses = poses[is_pose(poses) & (robot_of(poses) > 0)]
            if np.isin(keys, component.map.all_values.layout.keys).any():
                own = Oracle(outcome.log.with_tables([*rows_of(component.map, outcome.log), *rows]))
                free = component.map.base != WORLD and moves_in_the_world(own, int(poses[0]))
                findings.check("left out: rows of a world that a map is free to turn in", free, lost)
        return
    if lost.reason.endswith("the log is cut there"):
        _steps(lost, rows, outcome, findings)
        return
    if "with them no optimum was found, and the map of the rest has them far off" in lost.reason:
        wrong = [np.abs(t.whitened(oracle.truth)).max(-1) > BEYOND for t in rows]
        findings.check("left out: rows that contradict the rest", bool(np.concatenate(wrong).any()), lost)
        return
    if "nearer to the sensor than the map knows" in lost.reason:
        near = all(_nearer_than_known(oracle, *(int(k) for k in pair)) for t in rows for pair in t.keys)
        findings.check("left out: rows from nearer than is known", near, lost)
        return
    maps = [c.map.all_values.layout for c in outcome.components]
    inside = [row for t in rows for layout in maps for row in t.keys[t.told_by(layout)].tolist()]
    findings.check("left out: rows that no one map could hold", not inside, f"{lost.what}: {len(inside)} rows")


def _steps(lost: LeftOut, rows: list[Table], outcome: Outcome, findings: Findings) -> None:
    """One step of odometry, or several of one stretch: by itself it is far from where its map has it."""
    values = [c.map.all_values for c in outcome.components]
    told = [t.select(m) for t in rows for v in values if (m := t.told_by(v.layout)).any()]
    near = [v for t in told for v in values if t.told_by(v.layout).all()]
    far = [float(np.sum(t.whitened(v) ** 2, -1).min()) for t, v in zip(told, near, strict=True)]
    findings.check("left out: steps far from where the rest has them", min(far, default=np.inf) > 30.0, lost.what)


_KINDS: dict[str, Callable[[LeftOut, list[Table], Outcome, Oracle, Findings], None]] = {
    "piece": _piece,
    "landmark": _landmark,
    "poses": _poses,
    "rows": _loose_rows,
}


def _remark(remark: str, outcome: Outcome, oracle: Oracle, findings: Findings) -> None:
    log = outcome.log
    if match := re.fullmatch(r"robot (.+) measured nothing, and nobody saw it: it is in no map", remark, re.DOTALL):
        spoken = spoken_of(log.tables)
        robots = [r for r in log.robots if log.names.robot(r) == match[1]]
        silent = any(not (robot_of(spoken) == r).any() for r in robots)
        findings.check("remark: a robot that no row speaks of", silent, remark)
    elif match := re.fullmatch(r"submap (.+) stopped (\S+) sigma from its optimum, and is used as it is", remark):
        findings.check("remark: a submap that is nearly at its optimum", float(match[2]) <= LITTLE, remark)
    elif match := re.fullmatch(r"not exact: the map of .+ is that of the join .+ was found: (.+)", remark, re.DOTALL):
        is_true(match[1], "remark: a map that is not exact", outcome, oracle, findings)
    elif remark.startswith("joined in rounds, as by --exact, since the join of its submaps was far from"):
        ended = [c for c in outcome.components if c.solution is None or c.solution.converged]
        left = [(c.exactness.gradient_norm**2, c.map.cost) for c in ended if c.exactness is not None]
        done = all(decrease < 1e-6 * (cost + 1.0) for decrease, cost in left)
        findings.check("remark: a join that went on in rounds", done, f"{remark}; {left}")
    elif match := re.fullmatch(r"(.+): its (\d+) ranges come from one .+ give or take (\S+) m", remark):
        rows = [t for t in log.tables if t.source == "levels" and log.names.describe(int(t.keys[0, 1])) == match[1]]
        sigma = 1.0 / float(np.linalg.norm(rows[0].whitening[0, 0]))
        findings.check(
            "remark: a landmark that lies where all who range it are", abs(sigma / float(match[3]) - 1) < 0.1, remark
        )
    elif match := re.fullmatch(r"what was measured in the world tells of (\d) of the (\d) ways .+ has it", remark):
        held = [int(t.ranks.sum()) for t in log.tables if t.source == "frame"]
        findings.check("remark: a world that is told in part", int(match[2]) - int(match[1]) in held, remark)
    elif (true := fits_there(remark, [c.map for c in outcome.components], log.tables)) is not None:
        findings.check("remark: a landmark that fits at two places", true, remark)
    else:
        findings.check("a remark that cannot be checked", False, remark)
