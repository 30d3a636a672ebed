"""Nothing vanishes: every robot, pose, landmark and row that goes in comes out once, or is accounted for."""

from collections import Counter

import numpy as np

from stress.drive import Outcome
from stress.failure import Findings
from stress.maps import rows_of
from stress.oracle import spoken_of
from teamslam.model import WORLD, is_landmark, robot_of


def check_whole(outcome: Outcome, findings: Findings) -> None:
    """All that the rows speak of is in exactly one map or is named as left out; so is every row."""
    if outcome.joined is None:
        return
    spoken = spoken_of(outcome.log.tables)
    found = Counter(int(k) for c in outcome.components for k in c.map.keys if k != WORLD)
    left = set(left_out(outcome))
    names = outcome.log.names
    for what, keys in (("landmark", spoken[is_landmark(spoken)]), ("pose", spoken[robot_of(spoken) > 0])):
        lost = [int(k) for k in keys if int(k) not in found and int(k) not in left]
        findings.check(f"every {what} comes out", not lost, ", ".join(map(names.describe, lost[:3])))
    made_up = set(found) - set(spoken.tolist())
    findings.check("nothing comes out that did not go in", not made_up, sorted(made_up)[:3])
    told = set(_robots_left(outcome)) | _robots_remarked(outcome)
    silent = [r for r in outcome.log.robots if not any(robot_of(k) == r for k in found) and r not in told]
    findings.check("every robot comes out", not silent, ", ".join(map(names.robot, silent)))
    _rows(outcome, findings)


def _rows(outcome: Outcome, findings: Findings) -> None:
    """Every row is in one map, and in no more than one."""
    counts: Counter[tuple[int, str, int]] = Counter()
    for component in outcome.components:
        for table in rows_of(component.map, outcome.log):
            counts.update((table.robot, table.source, int(n)) for n in table.ids)
    rows = {(t.robot, t.source, int(n)) for t in outcome.log.tables for n in t.ids}
    twice = [row for row, count in counts.items() if count > 1]
    findings.check("no row is in two maps", not twice, twice[:3])
    lost = sorted(rows - set(counts) - rows_left_out(outcome))
    findings.check("every row comes out", not lost, f"{len(lost)} of {len(rows)}, such as {lost[:3]}")


def left_out(outcome: Outcome) -> list[int]:
    """The keys of what a map says it left out."""
    assert outcome.joined is not None
    return [int(key) for what in outcome.joined.left_out for key in what.keys]


def rows_left_out(outcome: Outcome) -> set[tuple[int, str, int]]:
    """The rows that a map says it left out."""
    assert outcome.joined is not None
    stretches = [stretch for what in outcome.joined.left_out for stretch in what.rows]
    return {(s.robot, s.source, n) for s in stretches for n in range(s.start, s.stop)}


def _robots_left(outcome: Outcome) -> list[int]:
    return sorted({int(robot_of(np.int64(k))) for k in left_out(outcome)})


def _robots_remarked(outcome: Outcome) -> set[int]:
    """Robots that no row speaks of, and that a remark says so of."""
    assert outcome.joined is not None
    names, said = outcome.log.names, "\n".join(outcome.joined.remarks)
    silent = set(outcome.log.robots) - set(robot_of(spoken_of(outcome.log.tables)).tolist())
    return {r for r in silent if f"robot {names.robot(r)} measured nothing, and nobody saw it" in said}
