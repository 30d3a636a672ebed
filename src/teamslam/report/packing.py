"""Arrays and words as JSON that may stand inside a page: numbers as bytes in base64, nothing that ends a script."""

import base64
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from teamslam.geometry import Array
from teamslam.report.contents import Page, Part, Rows, Way

ESCAPES = str.maketrans({"<": "\\u003c", ">": "\\u003e", "&": "\\u0026", "\u2028": "\\u2028", "\u2029": "\\u2029"})


def script_json(page: Page) -> str:
    """What the page's script draws from. Law: `json.loads` gives it back, and no `<` is left in it."""
    table: Mapping[str, Any] = {
        "robots": list(page.robots),
        "colours": list(page.colours),
        "counts": page.counts,
        "parts": [_part(part) for part in page.parts],
        "rows": [_rows(rows) for rows in page.rows],
        "rejected": [_rows(rows) for rows in page.rejected],
    }
    return json.dumps(table, allow_nan=False, separators=(",", ":")).translate(ESCAPES)


def _rows(rows: Rows) -> dict[str, Any]:
    return {"part": rows.part, "robot": rows.robot, "source": rows.source, "t": floats(rows.stamps),
            "size": floats(rows.size), "to": packed(rows.target, "<i4")}  # fmt: skip


def _part(part: Part) -> dict[str, Any]:
    marks, seen = part.marks, part.sightings
    placed = [way.places for way in part.ways] + [marks.places]
    corner = np.concatenate([p for p in placed if len(p)] or [np.zeros((1, 3))])
    origin = 0.5 * (corner.min(0) + corner.max(0))
    return {
        "title": part.title,
        "frame": part.frame,
        "spatial": part.spatial,
        "times": part.magnification,
        "quantile": part.quantile,
        "origin": origin.tolist(),  # floats of 32 bits hold what is near it
        "ways": [_way(way, origin) for way in part.ways],
        "marks": {
            "names": list(marks.names),
            "p": floats(marks.places - origin),
            "c": floats(_upper(marks.covariances)),
            "truth": floats(marks.truth - origin),
            "second": floats(marks.second - origin),
            "doubted": packed(marks.doubted, "<i1"),
        },
        "weakest": floats(part.weakest - origin),
        "weakest_times": part.weakest_times,
        "seen": {"who": packed(seen.robots, "<i4"), "t": floats(seen.stamps)},
    }


def _way(way: Way, origin: Array) -> dict[str, Any]:
    return {
        "robot": way.robot,
        "t": floats(way.stamps),
        "p": floats(way.places - origin),
        "f": packed(np.round(127.0 * way.forward), "<i1"),
        "truth": floats(way.truth - origin) if np.isfinite(way.truth).any() else "",
        "ct": floats(way.region_stamps),
        "c": floats(_upper(way.regions)),
    }


def _upper(blocks: Array) -> Array:
    rows, columns = np.triu_indices(3)
    return np.asarray(blocks[:, rows, columns])


def floats(array: Array) -> str:
    """32 bits each, one after another."""
    return packed(array, "<f4")


def packed(array: Any, kind: str) -> str:
    """The numbers of an array as bytes in base64."""
    return base64.b64encode(np.ascontiguousarray(array).astype(kind).tobytes()).decode("ascii")
