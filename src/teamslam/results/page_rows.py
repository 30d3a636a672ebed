"""Rows of measurements as a page draws them: when, how large what they leave is, what was seen."""

from collections.abc import Sequence

import numpy as np

from teamslam.answers.residuals import LANDMARK, Residuals
from teamslam.geometry import IntArray
from teamslam.model import Submap, index_of
from teamslam.report import Rows, evenly
from teamslam.results.record import Record

MOST_ROWS = 60_000  # drawn: of more every so many-th, and the worst


def rows_of(record: Record, robots: Sequence[str], start_s: float) -> tuple[list[Rows], list[str]]:
    """The rows that are drawn, and in words which, where these are not all."""
    total = sum(len(found.row) for found in record.rows)
    share = min(1.0, MOST_ROWS / max(total, 1))
    known = [landmarks_of(submap) for submap in record.maps]
    rows = [_drawn(found, known[found.component - 1], robots, start_s, share) for found in record.rows]
    said = f"Of {total:,} rows of measurements {sum(len(r.stamps) for r in rows):,} are drawn, the worst among them."
    return rows, [said] if share < 1.0 else []


def landmarks_of(submap: Submap) -> dict[str, int]:
    """The place of each landmark of a map, by its name."""
    marks = index_of(submap.landmark_keys).tolist()
    return {submap.names.landmark(mark): place for place, mark in enumerate(marks)}


def _drawn(found: Residuals, landmarks: dict[str, int], robots: Sequence[str], start_s: float, share: float) -> Rows:
    size, target = found.size, _targets(found.targets, landmarks, robots)[found.target]
    shown = np.flatnonzero(np.isfinite(found.stamp_s) & (target < len(landmarks)))
    shown = shown[evenly(size[shown], max(int(share * len(size)), 50))]
    shown = shown[np.argsort(found.stamp_s[shown], kind="stable")]
    return Rows(
        part=found.component - 1,
        robot=robots.index(found.robot),
        source=found.source,
        stamps=found.stamp_s[shown] - start_s,
        size=size[shown],
        target=target[shown],
    )


def _targets(words: Sequence[str], landmarks: dict[str, int], robots: Sequence[str]) -> IntArray:
    """Places of landmarks, -1 - places of robots; beyond all landmarks what is in no map."""
    numbers = {f"robot {robot}": -1 - place for place, robot in enumerate(robots)}
    numbers |= {f"{LANDMARK}{name}": place for name, place in landmarks.items()}
    return np.array([numbers.get(word, len(landmarks)) for word in words], np.int64)
