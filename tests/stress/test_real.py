"""Published logs, cut, thinned and renamed: each ends with a map near the truth, or says why not. And the reference
itself: the full least squares of each whole log lies near what is published of it.

`python benchmarks/stress.py --real NAME --seed N` tells one of them in full.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from stress.drive import DRIVES, go
from stress.failure import Findings
from stress.known import KNOWN
from stress.near import check_near
from stress.real import complete
from stress.verdict import judge_real
from teamslam.io import read
from thinned import thinned

HANDFUL = {"mrclam_7": 5, "mrclam5a.pyfg": 6, "plaza2.pyfg": 3, "distributed_mapper_4robots": 6, "islsjf_535": 4}
FIRST = 1_000_000


@pytest.mark.parametrize("name", thinned(2, list(HANDFUL)))
def test_a_variation_of_a_real_log_ends_with_a_map_or_a_true_sentence(name: str, data: Callable[[str], Path]) -> None:
    held = 0
    for seed in range(FIRST, FIRST + HANDFUL[name]):
        verdict = judge_real(seed, data, name=name)
        known = KNOWN.get((name, seed), ())
        failed = [f"{f.kind}: {f.detail}" for f in verdict.findings.failures if f.kind not in known]
        again = f"{verdict.scenario} (--real {name} --seed {seed} --drive '{verdict.drive}')"
        assert not failed, "\n".join([again, *failed])
        held += verdict.findings.held.total()
    assert held > 10 * HANDFUL[name]


@pytest.mark.parametrize("name", ["mrclam_7", "mrclam5a.pyfg", "plaza2.pyfg", "islsjf_535"])
def test_the_reference_of_a_whole_log_is_near_its_truth(name: str, data: Callable[[str], Path]) -> None:
    log, published = complete(name, data), read(data(name))
    assert log.truth.layout.contains(log.layout.keys).all() and np.isfinite(log.truth.state).all()
    findings = Findings()
    check_near(go(published, DRIVES["full"]), findings)
    assert findings.held["a map is near the truth"] == 1 and not findings.failures
