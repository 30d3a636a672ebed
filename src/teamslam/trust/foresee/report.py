"""plan.json and the map of a plan: what a script and a figure want to know.

frame          whose frame places are in
robots         of each by name: `end` and `worst` {place_m, heading_rad}, and along the `way` a list of stamp_s,
               place_m, heading_rad; null where it is not tied to the frame
landmarks      place_m of each by name; null likewise
unseen         landmarks that nobody will see
open           what hangs loose, in words;   directions: `sentence`, `sigma`, `unit`, `explained`, `share` of each
least          with these known, the worst place_m and heading_rad relative to the map as a whole, and whose
sightings      that would firm it up most: `sentence`, `gain` [nats], `ties`, `after` (sigma of each direction)
tags           the same of one more landmark: `at`, `sightings`, `robots` as well
sentences      all of it in words
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from teamslam.geometry import IntArray
from teamslam.model import Sources, Submap, is_landmark
from teamslam.trust.foresee.foresee import Foreseen
from teamslam.trust.foresee.tags import Tag
from teamslam.trust.weak.sightings import Sighting


def report_of(foreseen: Foreseen, sightings: Sequence[Sighting], tags: Sequence[Tag]) -> dict[str, Any]:
    """The plan as JSON holds it."""
    names, weak, keys = foreseen.names, foreseen.weak, foreseen.values.layout.keys
    marks = np.flatnonzero(is_landmark(keys))
    return {
        "frame": names.describe(foreseen.base),
        "robots": {names.robot(robot): _robot(foreseen, foreseen.way(robot)) for robot in foreseen.robots},
        "landmarks": {names.landmark(int(keys[n])): _number(foreseen.place_m[n]) for n in marks.tolist()},
        "unseen": list(foreseen.unseen),
        "open": list(weak.open_sentences),
        "directions": [
            {"sentence": d.sentence, "sigma": d.sigma, "unit": d.unit, "explained": d.explained, "share": d.share}
            for d in weak.directions
        ],
        "least": {
            "place_m": weak.least.place_m,
            "place": names.describe(weak.least.place),
            "heading_rad": weak.least.heading_rad,
            "heading": names.describe(weak.least.heading),
        },
        "sightings": [_gain(sighting) for sighting in sightings],
        "tags": [
            {**_gain(tag), "at": tag.at.tolist(), "sightings": tag.sightings, "robots": tag.robots} for tag in tags
        ],
        "sentences": list(foreseen.sentences),
    }


def map_of(foreseen: Foreseen) -> Submap:
    """The planned places as a map, in the frame of the first robot's start: what a figure draws. It has no
    information."""
    values, dof = foreseen.values, foreseen.values.layout.dof
    base = foreseen.values.pose(foreseen.base)
    others = values.transform(base.inverse()).select(values.layout.keys != foreseen.base)
    return Submap("plan", 0, foreseen.base, base.dim, others, lambda: _nothing(others.layout.dof), Sources(),
                  foreseen.names, rows=dof)  # fmt: skip


def _nothing(dof: int) -> Any:
    import scipy.sparse as sp

    return sp.csr_array((dof, dof))


def _robot(foreseen: Foreseen, way: IntArray) -> dict[str, Any]:
    place, heading = foreseen.place_m[way], foreseen.heading_rad[way]
    if np.isnan(place).all():
        return {"end": None, "worst": None, "way": None}
    stamps = foreseen.names.stamps_s(foreseen.values.layout.keys[way])
    return {
        "end": {"place_m": _number(place[-1]), "heading_rad": _number(heading[-1])},
        "worst": {"place_m": _number(np.nanmax(place)), "heading_rad": _number(np.nanmax(heading))},
        "way": [
            {"stamp_s": float(t), "place_m": _number(p), "heading_rad": _number(h)}
            for t, p, h in zip(stamps, place, heading, strict=True)
        ],
    }


def _gain(found: Sighting | Tag) -> dict[str, Any]:
    return {"sentence": found.sentence, "gain": found.gain, "ties": found.ties, "after": found.after.tolist()}


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
