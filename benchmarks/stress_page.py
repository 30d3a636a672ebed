"""The campaign that stress.py counted, as a page for the documentation."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

Row = dict[str, Any]

PAGE = """# Logs that nobody tuned for

{count:,} random logs, each made from a seed: a world (plane, planar robots among points in space, space, robots of both
kinds), one to eight robots with ways of their own (circles, straight drives, turns on the spot, standing still, half
turns, jumps), sensors of every model under every loss, noise from a micron to a hundred metres, and what goes wrong
with logs. Each goes through teamslam by one of its faces, with default settings, and **ends with a map, or with a
sentence that is true**. What is said is checked by an oracle that knows no submaps, starts or joins: ranks and sigmas
of the stacked Jacobian of the log's own rows at the truth, costs and gradients by differences, counts of what went in
and came out. A sentence that no check knows is a failure of its own. The generator, the oracle and the checks are in
`tests/stress`; the suite runs some thousand logs of other seeds.

{ended}

## What was checked

{held}

## By face

{drives}

## By noise

From fine (1 mm to 10 cm, 1 to 50 mrad) to wild (1e-6 to 1e2, each sensor for itself).

{noises}

## By what goes wrong

A log may have several; most have none or one.

{faults}

{failures}

{machine}. Command:

    python benchmarks/stress.py --seed {first} --count {small} --json small.json
    python benchmarks/stress.py --seed {first} --count {middle} --middle --json middle.json
    python benchmarks/stress.py --page docs/benchmarks/stress.md small.json middle.json
"""


def write(path: Path, small: Sequence[Row], middle: Sequence[Row], machine: str) -> None:
    """The page of a campaign of small and one of middle logs."""
    rows = [*small, *middle]
    held = sum((Counter(row["held"]) for row in rows), Counter[str]())
    failed = [row for row in rows if row["failures"]]
    statements = f"{held.total():,} statements held; {sum(len(row['failures']) for row in rows)} did not"
    path.write_text(
        PAGE.format(
            count=len(rows),
            ended=f"{_ends(rows)}. {statements}, in {len(failed)} logs.",
            held=_table(("what", "times"), ((what, f"{times:,}") for what, times in sorted(held.items()))),
            drives=_counts("face", rows, lambda row: (row["drive"],)),
            noises=_counts("noise", rows, lambda row: (row["noise"],)),
            faults=_counts("fault", rows, lambda row: row["faults"] or ("none",)),
            failures=_failures(rows),
            machine=machine,
            first=small[0]["seed"],
            small=len(small),
            middle=len(middle),
        ),
        encoding="utf-8",
    )


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


def _failures(rows: Sequence[Row]) -> str:
    kinds: dict[str, list[int]] = {}
    for row in rows:
        for failure in row["failures"]:
            kinds.setdefault(failure["kind"], []).append(row["seed"])
    if not kinds:
        return ""
    lines = ((kind, str(len(set(s))), ", ".join(map(str, dict.fromkeys(s[:4])))) for kind, s in sorted(kinds.items()))
    return "## What did not hold\n\n" + _table(("what", "logs", "seeds, such as"), lines)


def _table(head: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    body = ["| " + " | ".join(cell.replace("|", "/") for cell in line) + " |" for line in lines]
    return "\n".join(["| " + " | ".join(head) + " |", "|---|" + "---:|" * (len(head) - 1), *body])
