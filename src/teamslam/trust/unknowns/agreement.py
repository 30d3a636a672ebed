"""Whether landmarks agree on a number: what moved about makes a camera seem late, or early, as it seems to itself.

Each landmark has the number for its own, and all of them, and the map, are estimated together from where they are (as
stretches are, see `windows`). A latency is the same to all landmarks; one that some of them feign, since they moved, is
not. Without another prior than how much they know, a number stands where those that say the same (within AGREE of their
sigmas) know at least HALF of what all know together.
"""

from collections.abc import Sequence

import numpy as np

from teamslam.geometry import Array, BoolArray, IntArray
from teamslam.joining import AtMap
from teamslam.model import Table, Unknowns, is_landmark
from teamslam.trust.unknowns.effects import Effects
from teamslam.trust.unknowns.normal import beside_prior, eliminated

AGREE = 4.0  # sigmas: these take rows for independent
HALF = 0.5
MOST = 60  # landmarks that are asked, those that were seen most
VAGUE = 1e-6  # of the information of the prior: what keeps a landmark that says nothing from being undetermined


def contradicted(maps: Sequence[AtMap], unknowns: Unknowns, effects: Effects) -> BoolArray:
    """For each unknown (k,) whether landmarks contradict each other on the value that it has; False where fewer than
    two say anything."""
    marks = _asked(maps, effects)
    k = len(unknowns.each)
    out = np.zeros(k, bool)
    if len(marks) < 2:
        return out
    n = len(marks)
    own, slope = np.zeros((n * k, n * k)), np.zeros(n * k)
    for at in maps:
        left, pull = eliminated(at, lambda table, at=at: _apart(effects.at(at, table), table, marks))  # type: ignore[misc]
        own, slope = own + left, slope + pull
    for number, unknown in enumerate(unknowns.each):
        mine = slice(number, n * k, k)
        vague = unknown.prior / np.sqrt(VAGUE)
        known = beside_prior(own[mine, mine] + np.eye(n) / vague**2, np.full(n, vague))
        steps, sigmas = known @ slope[mine], np.sqrt(np.diag(known))
        says = sigmas < unknown.prior
        weights = np.where(says, sigmas**-2.0, 0.0)
        agree = np.abs(steps) <= AGREE * sigmas
        out[number] = np.count_nonzero(says) > 1 and weights[agree].sum() < HALF * weights.sum()
    return out


def _asked(maps: Sequence[AtMap], effects: Effects) -> IntArray:
    """The landmarks sightings of which depend on unknowns."""
    seen = [
        table.keys[effects.at(at, table).any((1, 2)), -1]
        for at in maps
        for table in at.tables
        if is_landmark(table.keys[:, -1]).any()
    ]
    marks, counts = np.unique(np.concatenate([np.zeros(0, np.int64), *seen]), return_counts=True)
    counts, marks = counts[is_landmark(marks)], marks[is_landmark(marks)]
    return np.sort(marks[np.argsort(-counts, kind="stable")[:MOST]])


def _apart(effect: Array, table: Table, marks: IntArray) -> Array:
    """The effects (m, rows, k) on each landmark by itself (m, rows, n k)."""
    mine = table.keys[:, -1][:, None] == marks
    return np.asarray((mine[:, None, :, None] * effect[:, :, None, :]).reshape(*effect.shape[:2], -1))
