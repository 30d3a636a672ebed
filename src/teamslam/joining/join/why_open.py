"""Why no map holds a landmark, in words: what there is of its sightings, and what their geometry leaves open.

rays     nearly parallel where the places they come from are no farther apart than they blur, or than these places are
         known: its distance is open
ranges   from nearly one line (in space: one plane): its side is open; from all around, and yet nothing tells on
         which side of the nearest sensor it is: they are blunt
held     where the map's poses and its own rows put it, and still no solve ends with it
"""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from teamslam.geometry import Array, IntArray
from teamslam.joining.start.triangulate import triangulate
from teamslam.model import WORLD, Submap, Table
from teamslam.solver import Covariances

WORLD_OPEN = (
    "they leave the map free to turn in the world, so it is written in the frame of its first pose; two positions apart"
    " (in space three not in line), or one measured pose, would hold it"
)
FAILS = (
    "they fix it, but solving for it together with the map fails; look for rows that contradict each other, or whose"
    " sigmas are very far apart"
)
PARALLEL = "rays that are nearly parallel leave its distance open; sightings from the side would tell"
IN_LINE = "ranges from nearly one place or line leave its side open; ranges from elsewhere would tell"
IN_PLANE = "ranges from nearly one place, line or plane leave its side open; ranges from elsewhere would tell"
BLUNT = (
    "they leave open on which side of the sensor nearest to it it is; sharper ranges, or from farther away, would tell"
)
LINE = 0.2  # of their spread: so near a line, or a plane, sensors are in it
BLUR = 5.0  # [sigmas of a bearing, or of the places it is taken from] between two rays that are nearly parallel


def why_open(key: int, parts: Sequence[Table], maps: Sequence[Submap]) -> str:
    """Why none of `maps` holds a landmark of which `parts` are all the rows."""
    if not parts:
        return "what was seen of it went with what is left out above"
    counts = Counter[str]()
    for part in parts:
        counts[part.model] += len(part)
    seen = " and ".join(f"{n} {_noun(model, n)}" for model, n in counts.items())
    seers = [_seers(whole, parts) for whole in maps]
    if not any(map(len, seers)) and not any(part.row.unary for part in parts):
        return f"no pose that saw it is in a map ({seen})"
    if all(part.row.unary for part in parts) and all(whole.base != WORLD for whole in maps):
        return f"{seen}: {WORLD_OPEN}"
    placed = [triangulate(whole.all_values, parts) for whole in maps]
    there = [
        (values.positions(np.array([key]), 3)[0], whole)
        for values, whole in zip(placed, maps, strict=True)
        if values.layout.contains(key)
    ]
    return f"{seen}: {_geometry(set(counts), there, [s for s in seers if len(s)], parts)}"


def _geometry(
    models: set[str], there: Sequence[tuple[Array, Submap]], seers: Sequence[Array], parts: Sequence[Table]
) -> str:
    """What leaves it open: by where it would be in each map, and from where it was seen."""
    if models == {"bearing"} and all(_are_parallel(place, whole, parts) for place, whole in there):
        return PARALLEL
    if there:
        return FAILS
    if models == {"range"}:
        dim = max(part.dim for part in parts)
        return (IN_LINE if dim == 2 else IN_PLANE) if all(_are_in_line(places, dim) for places in seers) else BLUNT
    return "they leave it open"


def _seers(whole: Submap, parts: Sequence[Table]) -> Array:
    """Where the poses of a map are that saw it (n, 3)."""
    return whole.all_values.positions(_who(whole, parts), 3)


def _who(whole: Submap, parts: Sequence[Table]) -> IntArray:
    """The poses of a map that saw it."""
    observers = [part.keys[:, 0] for part in parts if not part.row.unary]
    named = np.unique(np.concatenate([np.zeros(0, np.int64), *observers]))
    return named[whole.all_values.layout.contains(named)]


def _are_parallel(place: Array, whole: Submap, parts: Sequence[Table]) -> bool:
    """Whether the rays that meet there are hardly at an angle: those two that are farthest apart."""
    seers, values = _who(whole, parts), whole.all_values
    if not len(seers):
        return True
    rays = place - values.positions(seers, 3)
    away = np.maximum(np.linalg.norm(rays, axis=-1), 1e-300)
    rays /= away[:, None]
    one = int(np.linalg.norm(rays - rays.mean(0), axis=-1).argmax())
    apart = np.linalg.norm(rays - rays[one], axis=-1)
    other = int(apart.argmax())
    if one == other:
        return True
    between = Covariances.of_map(whole).relative(values, int(seers[one]), int(seers[other]))
    known = np.sqrt(np.linalg.eigvalsh(between[: whole.base_dim, : whole.base_dim])[-1]) / away[[one, other]].min()
    sharpest = max(float(np.abs(part.whitening).max(initial=0.0)) for part in parts)
    return bool(0.5 * apart[other] <= BLUR * max(1.0 / max(sharpest, 1e-300), known))


def _are_in_line(seers: Array, dim: int) -> bool:
    """Whether these places (n, 3) are nearly in a line, or in space in a plane."""
    if len(seers) < dim + 1:
        return True
    spread = np.linalg.svd((seers - seers.mean(0))[:, :dim], compute_uv=False)
    return bool(spread[dim - 1] <= LINE * max(spread[0], 1e-9))


def _noun(model: str, count: int) -> str:
    words = {"range_bearing": "range and bearing", "relative_pose": "relative pose"}
    plural = {"range_bearing": "ranges and bearings", "relative_pose": "relative poses"}
    return words.get(model, model) if count == 1 else plural.get(model, model + "s")
