"""Random logs by the hundred: every one ends with a map, or with a sentence that is true.

A failure names the seed; `python benchmarks/stress.py --seed N --drive NAME --shrink` tells that log in full and the
smallest part of it that fails in the same way. Other seeds: `pytest tests/stress --stress-seed N`. What is known to
fail is listed in `known`, log by log with what fails of it: nothing else may. `stress.py --known` writes that list
anew, and tells what of it no longer fails.
"""

from collections import Counter

import pytest

from stress.drive import drive_of
from stress.known import KNOWN
from stress.verdict import judge, judge_team

FIRST = 1_000_000  # of a block that nobody tunes on
SMALL, MIDDLE, TEAMS, CHUNKS = 96, 4, 4, 8  # logs, and tests that share the first two


@pytest.mark.parametrize("chunk", range(CHUNKS))
def test_every_log_ends_with_a_map_or_with_a_sentence_that_is_true(chunk: int, request: pytest.FixtureRequest) -> None:
    first = request.config.getoption("--stress-seed")
    failed, held = [], Counter[str]()
    for size, count in (("small", SMALL), ("middle", MIDDLE)):
        for seed in range(first + chunk, first + count, CHUNKS):
            verdict = judge(seed, middle=size == "middle")
            held.update(verdict.findings.held)
            again = f"--seed {seed} --drive '{drive_of(seed)}'{' --middle' if size == 'middle' else ''}"
            known = KNOWN.get((size, seed), ())
            failed += [f"{f.kind} ({again}): {f.detail}" for f in verdict.findings.failures if f.kind not in known]
    assert not failed, "\n".join(failed)
    assert held.total() > 10 * (SMALL + MIDDLE) / CHUNKS


@pytest.mark.parametrize("number", range(TEAMS))
def test_no_map_of_a_team_costs_more_than_the_optimum_from_the_truth(
    number: int, request: pytest.FixtureRequest
) -> None:
    seed = request.config.getoption("--stress-seed") + number
    verdict = judge_team(seed)
    known = KNOWN.get(("team", seed), ())
    failed = [f"{f.kind}: {f.detail}" for f in verdict.findings.failures if f.kind not in known]
    assert not failed, "\n".join([f"{verdict.scenario} (--teams --seed {seed} --drive {verdict.drive})", *failed])
    assert verdict.findings.held.total() > 10
