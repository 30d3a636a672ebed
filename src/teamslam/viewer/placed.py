"""Where several runs, and the maps of each, lie in one space.

The first run stands as it is. What another has in common with it is laid onto it by one rigid fit of the whole team,
as scores do; what cannot be (parts that nothing connects, runs of other logs) stands beside it.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from teamslam.config import Config
from teamslam.geometry import Pose
from teamslam.metrics import align_team
from teamslam.report import Page, Part
from teamslam.results.page import page_of
from teamslam.results.record import Record

GAP = 1.15  # of its size, from a map to the one beside it


@dataclass(frozen=True, eq=False)
class Placed:
    """A run as a page has it, and the frame of each of its parts in the common space."""

    name: str
    page: Page
    frames: tuple[Pose, ...]


def placed(runs: Mapping[str, Record]) -> list[Placed]:
    """The runs, by name, in one space; the first is where its own frame is."""
    first = next(iter(runs.values()))
    out: list[Placed] = []
    edge = 0.0
    for name, record in runs.items():
        page = page_of(record, Config())
        frames = []
        for number, part in enumerate(page.parts):
            frame = Pose.identity(3) if not out and number == 0 else _onto(record, number, first, out)
            left, right = _ends(part)
            if frame is None:
                frame = Pose(np.eye(3), np.array([edge - left, 0.0, 0.0]))
            edge = max(edge, float(frame.translation[0]) + right + (GAP - 1.0) * (right - left))
            frames.append(frame)
        out.append(Placed(name, page, tuple(frames)))
    return out


def _onto(record: Record, number: int, first: Record, out: list[Placed]) -> Pose | None:
    """The frame that lays a part onto that part of the first run with which it has most in common; None for none."""
    if not out:
        return None
    fits = [(align_team(record.maps[number], onto.all_values), frame)
            for onto, frame in zip(first.maps, out[0].frames, strict=False)]  # fmt: skip
    held = [(len(fit.keys), frame @ fit.pose.lift(3)) for fit, frame in fits if fit is not None and fit.held]
    return max(held, key=lambda entry: entry[0])[1] if held else None


def _ends(part: Part) -> tuple[float, float]:
    """From where to where a part reaches along x [m]."""
    places = np.concatenate([part.marks.places, *(way.places for way in part.ways)])
    return float(places[:, 0].min()), float(places[:, 0].max())
