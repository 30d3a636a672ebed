"""A log of each family of failures that campaigns found and that was cured since: it holds in all points."""

import pytest

from stress.verdict import judge

CURED = {
    7000007: "microns beside metres: a join that crept along a valley as narrow as its sharpest sigma",
}


@pytest.mark.parametrize("seed", CURED, ids=lambda seed: f"{seed} {CURED[seed].split(':')[0]}")
def test_it_holds(seed: int) -> None:
    assert judge(seed).findings.failures == []
