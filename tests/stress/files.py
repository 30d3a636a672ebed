"""A log that goes through a file is the same log: every row comes back, or is counted with its reason."""

from collections import Counter

import numpy as np

from stress.drive import ADDED, Outcome
from stress.failure import Findings
from teamslam.model import Dataset


def check_files(outcome: Outcome, findings: Findings) -> None:
    """Rows written and read again, by what they measure."""
    if outcome.file is None:
        return
    before, after = outcome.file.before, _as_read(outcome.log)
    lost = sum(d.count for d in outcome.file.dropped) + sum(d.count for d in after.dropped)
    went, came = _rows(before), _rows(after)
    missing = sum((went - came).values())
    findings.check("every row comes back from a file, or is counted", missing <= lost, f"{went - came}, counted {lost}")
    findings.check("a file makes no rows up", sum((came - went).values()) <= lost, came - went)
    if outcome.file.format == "plain":
        same = set(before.layout.keys.tolist()) == set(after.layout.keys.tolist())
        findings.check("a file keeps the names of all variables", same)
        if same and before.truth is not None:
            costs = [_cost(log, before) for log in (before, after)]
            findings.check("a file keeps numbers and noise", bool(np.isclose(*costs, rtol=1e-6, atol=1e-6)), costs)


def is_same(outcome: Outcome) -> bool:
    """Whether the log that was mapped measures what the one that was made does."""
    return outcome.file is None or _rows(outcome.file.before) == _rows(_as_read(outcome.log))


def _as_read(log: Dataset) -> Dataset:
    """A log without rows that a run added."""
    return log.with_tables([table for table in log.tables if table.source not in ADDED])


def _rows(log: Dataset) -> Counter[str]:
    counts: Counter[str] = Counter()
    for table in log.tables:
        counts[table.model] += len(table)
    return +counts


def _cost(log: Dataset, truthful: Dataset) -> float:
    assert truthful.truth is not None
    return sum(float(np.sum(t.whitened(truthful.truth) ** 2)) for t in log.tables if len(t))
