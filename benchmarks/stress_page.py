"""The campaign that stress.py counted, as a page for the documentation."""

import json
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from textwrap import fill
from typing import Any

from stress.known import KNOWN as KNOWN_FAILURES
from stress.near import SIGMAS, WRONG
from stress.test_stress import MIDDLE, SMALL, TEAMS

Row = dict[str, Any]

PAGE = """# Logs that nobody tuned for

{count:,} random logs, each made from a seed: a world (plane, planar robots among points in space, space, robots of both
kinds), one to eight robots with ways of their own (circles, straight drives, turns on the spot, standing still, half
turns, jumps), sensors of every model under every loss, noise from a micron to a hundred metres, and what goes wrong
with logs. Each goes through teamslam by one of its faces, noise as stated, and is to **end with a map, or with a
sentence that is true**; how many do is counted here. What is said is checked by an oracle that knows no submaps, starts
or joins: ranks and sigmas of the stacked Jacobian of the log's own rows at the truth, costs and gradients by
differences, counts of what went in and came out. A sentence that no check knows is a failure of its own. The generator,
the oracle and the checks are in `tests/stress`.

{suite}

{ended}

## What was checked

{held}

{unchecked}

## By face

{drives}

## By noise

From fine (1 mm to 10 cm, 1 to 50 mrad) to wild (1e-6 to 1e2, each sensor for itself).

{noises}

## By what goes wrong

A log may have several; most have none or one.

{faults}

{failures}

## Teams of hundreds of poses

{teams_count:,} teams of the simulator: two to five robots of 60 to 600 poses each, honest noise, sensors of every model
that see far or hardly, often or seldom, odometry that keeps the heading or loses it between two sightings. Most are too
large for the oracle's dense matrices; what counts here is that **no map that has converged costs more than the optimum
which a search from the truth ends in**, but by what it says itself: the gap that a join states, another place of a
landmark or another way to put the team together. (Of the random logs above the same is checked.)

{teams_ended}

{teams_held}

{teams_faults}

{teams_noises}

{teams_failures}

## Published logs, cut, thinned and renamed

{real_count:,} variations of published logs: fewer robots, windows of their time, a share of the sightings, rows lost,
odometry that is silent for a while, other losses, other numbers for robots and landmarks. The same is checked, and that
each map lies near the published truth (after one alignment; {wrong} m and {sigmas} of its own sigmas) or says why it
may not: a misfit, another way to put it together, a solve that stopped.

{real_ended}

{real_held}

{real_logs}

{real_changes}

{real_failures}

{machine}. Command:

    python benchmarks/stress.py --seed {first} --count {small} --json small.json
    python benchmarks/stress.py --seed {first} --count {middle} --middle --json middle.json
    python benchmarks/stress.py --seed {teams_first} --count {teams_count} --teams --json teams.json
    python benchmarks/stress.py --seed {real_first} --count {real_count} --real --json real.json
    python benchmarks/stress.py --page docs/benchmarks/stress.md small.json middle.json teams.json real.json
"""


LONGEST = 120  # letters in a line of the project's own code

KNOWN = '''"""KNOWN: logs of the suite that are known to fail, each with what fails. Written by `stress.py --known`."""
{long}
KNOWN: dict[tuple[str, int], tuple[str, ...]] = {{
{lines}}}
'''


def write_known(path: Path, failures: Mapping[tuple[str, int], Sequence[str]]) -> None:
    """What failed of the suite's logs, by size and seed, as a module of its tests."""
    lines = []
    for log, kinds in failures.items():
        told = "".join(f"        {json.dumps(kind, ensure_ascii=False)},\n" for kind in kinds)
        lines.append(f'    ("{log[0]}", {log[1]}): (\n{told}    ),\n')
    text = "".join(lines)
    long = "# ruff: noqa: E501\n" if any(len(line) > LONGEST for line in text.splitlines()) else ""
    path.write_text(KNOWN.format(lines=text, long=long), encoding="utf-8")


def write(
    path: Path, small: Sequence[Row], middle: Sequence[Row], teams: Sequence[Row], real: Sequence[Row], machine: str
) -> None:
    """The page of a campaign of small logs, one of middle logs, one of teams, and one of published logs."""
    rows = [*small, *middle]
    path.write_text(
        PAGE.format(
            count=len(rows),
            suite=_suite(),
            ended=_ended(rows),
            held=_held(rows),
            unchecked=_unchecked([*rows, *teams, *real]),
            drives=_counts("face", rows, lambda row: (row["drive"],)),
            noises=_counts("noise", rows, lambda row: (row["noise"],)),
            faults=_counts("fault", rows, lambda row: row["faults"] or ("none",)),
            failures=_failures(rows),
            teams_count=len(teams),
            teams_ended=_ended(teams),
            teams_held=_held(teams),
            teams_faults=_counts("seen", teams, lambda row: row["faults"]),
            teams_noises=_counts("heading", teams, lambda row: (row["noise"],)),
            teams_failures=_failures(teams, "###"),
            teams_first=teams[0]["seed"],
            real_count=len(real),
            real_ended=_ended(real),
            real_held=_held(real),
            real_logs=_counts("log", real, lambda row: (row["space"],)),
            real_changes=_counts("change", real, lambda row: row["faults"] or ("none",)),
            real_failures=_failures(real, "###"),
            wrong=WRONG,
            sigmas=SIGMAS,
            machine=machine,
            first=small[0]["seed"],
            small=len(small),
            middle=len(middle),
            real_first=real[0]["seed"],
        ),
        encoding="utf-8",
    )


def _suite() -> str:
    """What the suite runs, and what of it is known to fail."""
    known = [sum(size == of for size, _ in KNOWN_FAILURES) for of in ("small", "middle", "team")]
    return _wrapped(
        f"The suite runs {SMALL:,} small logs, {MIDDLE} middle ones and {TEAMS} teams of other seeds, of which "
        f"{known[0]}, {known[1]} and {known[2]} are listed with what is known to fail (`tests/stress/known.py`)."
    )


def _ended(rows: Sequence[Row]) -> str:
    held = sum(sum(row["held"].values()) for row in rows)
    failed = [row for row in rows if row["failures"]]
    good = len(rows) - len(failed)
    statements = (
        f"{held:,} statements held; {sum(len(row['failures']) for row in rows):,} did not, in {len(failed)} logs"
    )
    return _wrapped(f"{_ends(rows)}. **{good:,} of {len(rows):,} logs hold in all points.** {statements}.")


def _wrapped(text: str) -> str:
    return fill(text, 120, break_long_words=False, break_on_hyphens=False)


def _held(rows: Sequence[Row]) -> str:
    held = sum((Counter(row["held"]) for row in rows), Counter[str]())
    return _table(("what", "times"), ((what, f"{times:,}") for what, times in sorted(held.items())))


def _unchecked(rows: Sequence[Row]) -> str:
    """What no oracle of dense matrices can tell."""
    count = sum(sum(row["unchecked"].values()) for row in rows)
    return f"{count:,} sentences were about logs too large for the oracle's dense matrices, and were not checked."


def _ends(rows: Sequence[Row]) -> str:
    counts = Counter(row["ended"] for row in rows)
    return ", ".join(f"{counts[how]:,} in {how}" for how in ("one map", "several maps", "a sentence") if counts[how])


def _counts(what: str, rows: Sequence[Row], groups: Callable[[Row], Iterable[str]]) -> str:
    """A table of how logs ended, by a property of theirs."""
    by: dict[str, list[Row]] = {}
    for row in rows:
        for name in groups(row):
            by.setdefault(name, []).append(row)
    lines = []
    for name, of in sorted(by.items()):
        ends = Counter(row["ended"] for row in of)
        numbers = [len(of), *(ends[how] for how in ("one map", "several maps", "a sentence"))]
        numbers += [sum(sum(row["held"].values()) for row in of), sum(bool(row["failures"]) for row in of)]
        lines.append((name, *(f"{n:,}" for n in numbers)))
    return _table(
        (what, "logs", "one map", "several maps", "a sentence", "statements held", "logs with a failure"), lines
    )


def _failures(rows: Sequence[Row], level: str = "##") -> str:
    kinds: dict[str, list[int]] = {}
    for row in rows:
        for failure in row["failures"]:
            kinds.setdefault(failure["kind"], []).append(row["seed"])
    if not kinds:
        return ""
    lines = ((kind, str(len(set(s))), ", ".join(map(str, dict.fromkeys(s[:4])))) for kind, s in sorted(kinds.items()))
    return f"{level} What did not hold\n\n" + _table(("what", "logs", "seeds, such as"), lines)


def _table(head: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    body = ["| " + " | ".join(cell.replace("|", "/") for cell in line) + " |" for line in lines]
    return "\n".join(["| " + " | ".join(head) + " |", "|---|" + "---:|" * (len(head) - 1), *body])
