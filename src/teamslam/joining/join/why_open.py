"""Why no map holds a landmark, in words: what there is of its sightings, and what their geometry leaves open.

rays     nearly parallel where the places they come from are no farther apart than they blur, or than these places are
         known: its distance is open; at an angle, and yet no place is near to all: they, or the poses, are wrong
ranges   from nearly one line (in space: one plane): its side is open; from all around, and yet nothing tells on
         which side of the nearest sensor it is: they are blunt
held     where the map's poses and its own rows put it, and still no solve ends with it

Poses of maps that stand apart tell each by themselves: what is said is then said of each.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from teamslam.geometry import Array, IntArray, directions
from teamslam.joining.start.triangulate import Bundle, kinds_of, triangulate
from teamslam.model import SQUARED, WORLD, Kind, Submap, Table, chi2_quantile
from teamslam.solver import Covariances

WORLD_OPEN = (
    "they leave the map free to shift or turn in the world, so it is written in the frame of its first pose; two whole"
    " positions apart (in space three not in line), or one measured pose, would hold it"
)
FAILS = (
    "they fix it, but solving for it together with the map fails; look for rows that contradict each other, or whose"
    " sigmas are very far apart"
)
PARALLEL = "rays that are nearly parallel leave its distance open; sightings from the side would tell"
IN_LINE = "ranges from nearly one place or line leave its side open; ranges from elsewhere would tell"
IN_PLANE = "ranges from nearly one place, line or plane leave its side open; ranges from elsewhere would tell"
LOOSE = "how the poses that saw it lie to each other is known too badly to tell where it is"
SKEW = "at the poses of the map no place fits these rays; look for bearings that are wrong, or for poses that are"
BLUNT = (
    "they leave open on which side of the sensor nearest to it it is; sharper ranges, or from farther away, would tell"
)
NARROW = 0.2  # [rad]: rays at a wider angle are nearly parallel to nobody
LINE = 0.2  # of their spread: so near a line, or a plane, sensors are in it
FITS = 0.999  # of the places that rays truly come from fit so well
FEW, AHEAD = 8, np.geomspace(0.01, 1e4, 13)  # rays, and how far along them [m], from where a place is looked for
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
    some = [whole for whole, of in zip(maps, seers, strict=True) if len(of)]
    apart = f" from poses of {len(some)} maps, in each of which" if len(some) > 1 and not there else ":"
    return f"{seen}{apart} {_geometry(set(counts), there, some, parts)}"


def _geometry(
    models: set[str], there: Sequence[tuple[Array, Submap]], some: Sequence[Submap], parts: Sequence[Table]
) -> str:
    """What leaves it open: by where it would be in each map, and from where in `some` it was seen."""
    dim = max(part.dim for part in parts)
    if models == {"bearing"} and all(part.dim == dim for part in parts) and some:
        blurred = bool(there) and all(_are_blurred(place, whole, parts) for place, whole in there)
        if all(_apart(whole, parts) <= (NARROW if blurred else 0.0) for whole in some):
            return PARALLEL
        if not any(_meet(whole, parts) for whole in some):
            return LOOSE if all(_meet(whole, parts, _turned(whole, parts)) for whole in some) else SKEW
        if blurred:
            return LOOSE
    if there:
        return FAILS
    if models == {"range"}:
        in_line = all(_are_in_line(_seers(whole, parts), dim) for whole in some)
        return (IN_LINE if dim == 2 else IN_PLANE) if in_line else BLUNT
    return "they leave it open"


def _seers(whole: Submap, parts: Sequence[Table]) -> Array:
    """Where the poses of a map are that saw it (n, 3)."""
    return whole.all_values.positions(_who(whole, parts), 3)


def _who(whole: Submap, parts: Sequence[Table]) -> IntArray:
    """The poses of a map that saw it."""
    observers = [part.keys[:, 0] for part in parts if not part.row.unary]
    named = np.unique(np.concatenate([np.zeros(0, np.int64), *observers]))
    return named[whole.all_values.layout.contains(named)]


def _are_blurred(place: Array, whole: Submap, parts: Sequence[Table]) -> bool:
    """Whether those two of the rays that meet there that are farthest apart are so by no more than they, or the poses
    that they come from, blur."""
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
    dim = whole.base_dim
    at, turn = between[:dim, :dim], between[dim:, dim:]
    known = _largest(at) / away[[one, other]].min()
    turned = _largest(turn)
    return bool(0.5 * apart[other] <= BLUR * max(_blur(parts), known, turned))


def _blur(parts: Sequence[Table]) -> float:
    """The least sigma of a bearing."""
    return 1.0 / max(1e-300, *(float(np.abs(part.whitening).max(initial=0.0)) for part in parts))


def _apart(whole: Submap, parts: Sequence[Table]) -> float:
    """The widest angle [rad] between two rays, as measured at a map's poses; 0 where it is no more than they blur."""
    _, rays = _rays(whole, parts)
    apart = max(float(np.linalg.norm(rays - ray, axis=-1).max()) for ray in rays)
    return apart if 0.5 * apart > BLUR * _blur(parts) else 0.0


def _rays(whole: Submap, parts: Sequence[Table]) -> tuple[Array, Array]:
    """Where bearings from a map's poses begin, and along which unit vectors they go (m, d)."""
    eyes, rays = [], []
    for part in _from(whole, parts):
        bodies = whole.all_values.poses_of(part.keys[:, 0], part.dim)
        sensors = bodies if part.sensor is None else bodies @ part.sensor
        eyes.append(sensors.translation)
        rays.append((sensors.rotation @ directions(part.dim).ray(part.values)[..., None])[..., 0])
    return np.concatenate(eyes), np.concatenate(rays)


def _turned(whole: Submap, parts: Sequence[Table]) -> float:
    """How badly [rad] it is known how the poses of a map that saw it are turned, seen from the first of them."""
    first, *others = _who(whole, parts).tolist()
    values, covariances, dim = whole.all_values, Covariances.of_map(whole), whole.base_dim
    turns = [covariances.relative(values, first, other)[dim:, dim:] for other in others]
    return max(map(_largest, turns), default=0.0)


def _largest(covariance: Array) -> float:
    """The largest sigma; of what is known to rounding 0."""
    return float(np.sqrt(max(np.linalg.eigvalsh(covariance)[-1], 0.0)))


def _meet(whole: Submap, parts: Sequence[Table], turned: float = 0.0) -> bool:
    """Whether some place fits all rays from a map's poses as well as their sigmas, and how the poses may be `turned`
    [rad], have it."""
    rays = [part.with_loss(SQUARED) for part in _from(whole, parts)]
    rays = [replace(ray, whitening=ray.whitening / np.hypot(1.0, turned / _blur([ray]))) for ray in rays]
    layout = kinds_of(rays)
    bundle = Bundle.of(rays, whole.all_values, layout.keys, Kind(int(layout.kinds[0])).dim)
    eyes, along = _rays(whole, rays)
    some = np.unique(np.linspace(0, len(eyes) - 1, min(len(eyes), FEW)).astype(int))
    ahead = [(eyes + away * along)[some] for away in AHEAD]
    _, costs, _ = bundle.refined(np.concatenate([*ahead, bundle.proposals()[:, 0]])[:, None])
    spare = sum(part.dof for part in rays) - bundle.dim
    return bool(np.nanmin(costs, initial=np.inf) <= chi2_quantile(FITS, max(spare, 1)))


def _from(whole: Submap, parts: Sequence[Table]) -> list[Table]:
    """The sightings from poses of a map."""
    own = [part.select(whole.all_values.layout.contains(part.keys[:, 0])) for part in parts if not part.row.unary]
    return [part for part in own if len(part)]


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
