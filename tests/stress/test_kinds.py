"""Random logs are of all kinds: what is drawn is counted, so that no kind falls out unnoticed."""

from collections import Counter
from itertools import product

import numpy as np
import pytest

from stress.drive import DRIVES, drive_of
from stress.faults import FAULTS
from stress.real import CHANGES, DRIVEN, LOGS
from stress.scenario import LOSSES, MEET, NOISES, OF_LANDMARKS, OF_ROBOTS, SPACES, Scenario, draw
from stress.test_stress import FIRST
from stress.ways import WAYS
from stress.world import log_of
from teamslam.model import LOSSES as KNOWN_LOSSES
from teamslam.model import MODELS

DRAWN = 400  # logs of the block that the suite begins and campaigns go through
FEWEST = 1  # times that each kind is drawn at least
BEYOND = 8.0  # sigmas: no honest noise
HARMLESS = {"shuffled", "odd names", "empty table", "backward", "gaps", "double rows", "big stamps"}


@pytest.fixture(scope="module")
def scenarios() -> list[Scenario]:
    """Small logs of the block whose first ones the suite maps."""
    return [draw(seed) for seed in range(FIRST, FIRST + DRAWN)]


def missing(counts: Counter, kinds: object) -> list:
    return [kind for kind in kinds if counts[kind] < FEWEST]


def test_every_space_way_meeting_noise_fault_and_face(scenarios: list[Scenario]) -> None:
    counts = Counter(s.space for s in scenarios)
    counts.update(r.way for s in scenarios for r in s.robots)
    counts.update(f"meet {s.meet}" for s in scenarios)
    counts.update(f"noise {s.noise}" for s in scenarios)
    counts.update(fault for s in scenarios for fault in s.faults)
    counts.update(f"by {drive_of(s.seed)}" for s in scenarios)
    wanted = [*SPACES, *WAYS, *(f"meet {m}" for m in MEET), *(f"noise {n}" for n in NOISES), *FAULTS]
    assert not missing(counts, [*wanted, *(f"by {name}" for name in DRIVES)])


def test_every_model_of_what_is_seen_under_every_loss(scenarios: list[Scenario]) -> None:
    counts = Counter((s.of, s.model, s.loss.name) for scenario in scenarios for s in scenario.senses)
    wanted = [("landmarks", model, loss) for model, loss in product(OF_LANDMARKS, LOSSES)]
    wanted += [("robots", model, loss) for model, loss in product(OF_ROBOTS, LOSSES)]
    wanted += [("odometry", "relative_pose", loss) for loss in LOSSES]
    assert not missing(counts, wanted)
    models = {s.model for scenario in scenarios for s in scenario.senses}
    assert models == {name for name, row in MODELS.items() if not row.given} and set(LOSSES) == set(KNOWN_LOSSES)


@pytest.mark.parametrize("of", ["odometry", "landmarks", "robots"])
def test_noise_of_every_power_of_ten(scenarios: list[Scenario], of: str) -> None:
    senses = [s for scenario in scenarios for s in scenario.senses if s.of == of]
    lengths = Counter(int(np.floor(np.log10(s.sigma_m))) for s in senses)
    angles = Counter(int(np.floor(np.log10(s.sigma_rad))) for s in senses if s.of == "odometry")
    assert not missing(lengths, range(-6, 2))
    if of == "odometry":
        assert not missing(angles, range(-6, 2))


def test_outliers_of_every_share(scenarios: list[Scenario]) -> None:
    """By the rows themselves: those that no honest noise explains, in tenths of all sightings."""
    shares: Counter[int] = Counter()
    for scenario in scenarios:
        wrong = {"few outliers", "many outliers"} & set(scenario.faults)
        if not wrong or set(scenario.faults) - wrong - HARMLESS or scenario.noise not in ("fine", "tiny", "coarse"):
            continue
        log = log_of(scenario)
        seen = [t for t in log.tables if t.source in ("landmarks", "robots")]
        if sum(map(len, seen)) < 10:
            continue
        wild = np.concatenate([np.linalg.norm(t.whitened(log.truth), axis=-1) > BEYOND for t in seen])
        shares[int(10 * wild.mean())] += 1
    assert all(shares[tenth] for tenth in range(4)), shares


def test_every_published_log_is_changed_in_every_way() -> None:
    """The odds alone: that they are drawn is what a campaign counts."""
    assert min(LOGS.values()) > 0.05 and min(odds for odds, _ in CHANGES.values()) > 0.2
    assert {"join", "exact", "full", "sequential", "tree", "command"} <= set(DRIVEN)
