"""Landmarks that are said to fit at two places, or at none: SciPy looks for them, with all poses where they are."""

import re
from collections.abc import Sequence

import numpy as np
from scipy.optimize import minimize
from scipy.stats import chi2

from teamslam.geometry import Array, IntArray, directions
from teamslam.model import Submap, Table, Values, is_landmark, point_kind
from teamslam.solver import Solution, System, optimise

TWO = re.compile(r"ambiguous: (.+) is at \((.+)\) or at \((.+)\), for (?:no|at most (\S+)) more of cost: .+", re.DOTALL)
SIDE = re.compile(
    r"(.+): ranges from robots of a plane leave open on which side of it, and the map says (above|below)", re.DOTALL
)
OTHERS = re.compile(r"ambiguous in the same way: (.+)")


def fits_there(remark: str, maps: Sequence[Submap], tables: Sequence[Table]) -> bool | None:
    """Whether what a remark says of second places is true; None where it speaks of none."""
    if match := TWO.fullmatch(remark):
        there = np.array([float(number) for number in match[3].split(",")])
        return any(_costs(whole, match[1], there, tables) <= float(match[4] or 0.0) * 1.1 + 0.1 for whole in maps)
    if match := SIDE.fullmatch(remark):
        names = re.sub(r" and \d+ others$", "", match[1]).split(", ")
        side = 1.0 if match[2] == "above" else -1.0
        return any(all(_mirrored(whole, name, side, tables) for name in names) for whole in maps)
    if match := OTHERS.fullmatch(remark):
        names = re.sub(r" and \d+ others$", "", match[1]).split(", ")
        return any(all(_key(whole, name) is not None for name in names) for whole in maps)
    return None


def is_told(best: Solution, whole: Submap, system: System, remarks: Sequence[str]) -> bool:
    """Whether another optimum of a map's rows is one that remarks tell of: the map with the landmarks that they say may
    be elsewhere where that optimum has them, and all else where it is, leads there."""
    keys = _elsewhere(whole, best.values, remarks)
    if not len(keys):
        return False
    stays = ~np.isin(whole.values.layout.keys, keys)
    found = optimise(system, best.values.update(whole.values.select(stays)))
    off = best.values.only(whole.values.layout.keys).minus(found.values.only(whole.values.layout.keys))
    return bool(off @ (whole.information @ off) < 1.0)


def _elsewhere(whole: Submap, there: Values, remarks: Sequence[str]) -> IntArray:
    """The landmarks of a map that remarks say may be elsewhere: those that they name, and of others that they only
    count as many, those that are farthest from where they are."""
    marks = whole.values.layout.keys[is_landmark(whole.values.layout.keys)]
    called = {whole.names.describe(int(key)): int(key) for key in marks}
    told: set[int] = set()
    more = 0
    for match in filter(None, (p.fullmatch(r) for r in remarks for p in (TWO, SIDE, OTHERS))):
        listed, _, counted = match[1].partition(" and ")
        mine = {called[name] for name in listed.split(", ") if name in called}
        told |= mine
        more += int(re.sub(r" others.*", "", counted) or 0) if mine else 0
    far = np.linalg.norm(there.positions(marks, 3) - whole.values.positions(marks, 3), axis=-1)
    others = [int(key) for key in marks[np.argsort(-far)] if int(key) not in told]
    return np.array([*told, *others[:more]], np.int64)


def _key(whole: Submap, name: str) -> int | None:
    marks = whole.keys[is_landmark(whole.keys)].tolist()
    return next((key for key in marks if whole.names.describe(key) == name), None)


def _costs(whole: Submap, name: str, there: Array, tables: Sequence[Table]) -> float:
    """How much more than where it is a landmark costs at its optimum near another place; inf where there is none."""
    if (key := _key(whole, name)) is None:
        return np.inf
    values, kind = whole.all_values, point_kind(len(there))
    rows = [t.select((t.keys[:, -1] == key) & np.asarray(values.layout.contains(t.keys).all(1))) for t in tables]

    def cost(place: Array) -> float:
        moved = values.update(Values.of({kind: (np.array([key]), place[None])}))
        return sum(float(t.loss.cost((t.whitened(moved) ** 2).sum(1)).sum()) for t in rows if len(t))

    here = values.positions(np.array([key]), len(there))[0]
    near = minimize(cost, there, method="Nelder-Mead", options={"xatol": 1e-6, "fatol": 1e-6, "maxiter": 4000})
    best = minimize(cost, here, method="Nelder-Mead", options={"xatol": 1e-6, "fatol": 1e-6, "maxiter": 4000})
    return float(near.fun - best.fun) if np.linalg.norm(near.x - best.x) > 1e-3 else np.inf


def rays_meet(whole: Submap, key: int, rows: Sequence[Table]) -> bool:
    """Whether bearings of a landmark, from poses of a map, agree on a place as well as their sigmas have it: looked for
    from many distances along every ray."""
    values, dim = whole.all_values, max(t.dim for t in rows)
    seen = [t.select(values.layout.contains(t.keys[:, 0])) for t in rows]
    seen = [t for t in seen if len(t)]

    def cost(place: Array) -> float:
        at = values.update(Values.of({point_kind(dim): (np.array([key]), place[None])}))
        return sum(float((t.whitened(at) ** 2).sum()) for t in seen)

    found = np.inf
    for table in seen:
        bodies = values.poses_of(table.keys[:, 0], dim)
        eyes = bodies if table.sensor is None else bodies @ table.sensor.lift(dim)
        rays = (eyes.rotation @ directions(dim).ray(table.values)[..., None])[..., 0]
        for eye, ray in zip(eyes.translation, rays, strict=True):
            starts = [eye + away * ray for away in np.geomspace(0.01, 1000.0, 11)]
            best = min(starts, key=cost)
            found = min(found, float(minimize(cost, best, method="Nelder-Mead", options={"maxiter": 4000}).fun))
    return found <= chi2.ppf(0.999, max(sum(t.dof for t in seen) - dim, 1))


def _mirrored(whole: Submap, name: str, side: float, tables: Sequence[Table]) -> bool:
    """Whether a landmark is on one side of the robots' plane, and costs the same on the other."""
    key = _key(whole, name)
    if key is None:
        return False
    here = whole.values.positions(np.array([key]), 3)[0]
    return side * here[2] >= 0.0 and _costs(whole, name, here * [1.0, 1.0, -1.0], tables) <= 0.1
