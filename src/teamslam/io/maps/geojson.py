"""Maps as GeoJSON (RFC 7946), for web maps and geographic information systems; of a map with an anchor.

A FeatureCollection: each robot's way is a LineString with the stamps [s] of its places as `stamps_s`, each landmark a
Point with its standard deviations `sigma_m`, each 95 % region a Polygon; `kind` is robot, landmark or region.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from teamslam.geometry import Anchor
from teamslam.io.files.text import write_text
from teamslam.io.maps.earth import POSES, TURNED, Feature, features
from teamslam.io.maps.estimate import MapEstimate, paths_of
from teamslam.io.maps.marks import lost
from teamslam.model import Dropped

SHAPES = {"robot": "LineString", "landmark": "Point", "region": "Polygon"}


def write(maps: Sequence[MapEstimate], path: Path, anchor: Anchor) -> tuple[Dropped, ...]:
    """Writes each map into a file of its own. Law: the anchor takes each place back to the map, to its digits."""
    for found, file in zip(maps, paths_of(path, len(maps)), strict=True):
        content = {"type": "FeatureCollection", "features": [_written(f) for f in features(found, anchor)]}
        write_text(file, json.dumps(content, ensure_ascii=False, allow_nan=False) + "\n")
    return lost(maps, POSES, TURNED)


def _written(feature: Feature) -> dict[str, Any]:
    rows: Any = feature.coordinates
    where = {"robot": rows, "landmark": rows[0], "region": [rows]}[feature.kind]
    return {
        "type": "Feature",
        "geometry": {"type": SHAPES[feature.kind], "coordinates": where},
        "properties": {"kind": feature.kind, "name": feature.name, **feature.known},
    }
