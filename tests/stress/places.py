"""Landmarks that are said to fit at two places, or at none: SciPy looks for them, with all poses where they are."""

import re
from collections.abc import Sequence

import numpy as np
from scipy.optimize import minimize
from scipy.stats import chi2

from teamslam.geometry import Array, IntArray, Pose, directions
from teamslam.model import Kind, Submap, Table, Values, is_landmark, point_kind, robot_of
from teamslam.solver import Solution, System, optimise

TWO = re.compile(r"ambiguous: (.+) is at \((.+)\) or at \((.+)\), for (?:no|at most (\S+)) more of cost: .+", re.DOTALL)
SIDE = re.compile(
    r"(.+): ranges from robots of a plane leave open on which side of it, and the map says (above|below)", re.DOTALL
)
OTHERS = re.compile(r"ambiguous in the same way: (.+)")
MIRROR = re.compile(
    r"ambiguous: (?:robot (.+) fits on the other side of what it ranges|the whole map fits in a mirror) too, "
    r"for (?:no|(\S+)) more of cost; .+",
    re.DOTALL,
)


def fits_there(remark: str, maps: Sequence[Submap], tables: Sequence[Table]) -> bool | None:
    """Whether what a remark says of second places is true; None where it speaks of none."""
    if match := TWO.fullmatch(remark):
        there = np.array([float(number) for number in match[3].split(",")])
        return any(_costs(whole, match[1], there, tables) <= float(match[4] or 0.0) * 1.1 + 0.1 for whole in maps)
    if match := SIDE.fullmatch(remark):
        names = re.sub(r" and \d+ others$", "", match[1]).split(", ")
        side = 1.0 if match[2] == "above" else -1.0
        return any(all(_mirrored(whole, name, side, tables) for name in names) for whole in maps)
    if match := MIRROR.fullmatch(remark):
        return any(_fits_in_mirror(whole, match[1], float(match[2] or 0.0) * 1.1 + 0.1, tables) for whole in maps)
    if match := OTHERS.fullmatch(remark):
        names = re.sub(r" and \d+ others$", "", match[1]).split(", ")
        return any(all(_key(whole, name) is not None for name in names) for whole in maps)
    return None


def _fits_in_mirror(whole: Submap, name: str | None, more: float, tables: Sequence[Table]) -> bool:
    """Whether a map of the plane, or one robot of it with what it alone sees, costs so little more at the optimum that
    a reflection leads to: of a robot about the line through what it and others know."""
    values = whole.all_values if whole.base >= 0 else whole.values
    rows = [t.select(np.asarray(t.told_by(values.layout))) for t in tables]
    rows = [t for t in rows if len(t)]
    keys = values.layout.keys
    if name is None:
        mine, line = keys, values.poses_of(np.array([whole.base]), 2).xytheta()[0]
    else:
        robots = np.unique(robot_of(keys[~is_landmark(keys)])).tolist()
        robot = next((r for r in robots if whole.names.robot(r) == name), None)
        if robot is None:
            return False
        seen = np.unique(np.concatenate([t.keys.ravel() for t in rows if (robot_of(t.keys) == robot).any()]))
        others = np.unique(np.concatenate([t.keys[robot_of(t.keys) != robot] for t in rows if t.robot != robot]))
        shared = np.intersect1d(seen[robot_of(seen) != robot], others if len(others) else seen)
        if not len(shared):
            return False
        places = values.positions(shared, 2)
        (dx, dy), middle = np.linalg.svd(places - places.mean(0))[2][0], places.mean(0)
        mine, line = np.setdiff1d(seen, others), np.array([*middle, np.arctan2(dy, dx)])
    fixed = np.array([whole.base]) if whole.base >= 0 else np.zeros(0, np.int64)
    mine = np.setdiff1d(keys, mine) if name is not None and np.isin(fixed, mine).any() else mine
    system = System(values.layout, tables=rows, fixed=fixed)
    here, there = (optimise(system, start) for start in (values, _reflected(values, mine, line)))
    return there.cost - here.cost <= more


def _reflected(values: Values, keys: IntArray, line: Array) -> Values:
    """Some variables of the plane on the other side of a line (x, y, direction)."""
    x, y, along = line
    cos, sin = np.cos(2.0 * along), np.sin(2.0 * along)
    for key in keys.tolist():
        pose = not is_landmark(key)
        px, py = values.positions(np.array([key]), 2)[0] - (x, y)
        place = np.array([[x + cos * px + sin * py, y + sin * px - cos * py]])
        if pose:
            heading = values.poses_of(np.array([key]), 2).xytheta()[0, 2]
            at = Pose.from_xytheta(np.array([[*place[0], 2.0 * along - heading]]))
            values = values.update(Values.of({Kind.POSE2: (np.array([key]), at)}))
        else:
            values = values.update(Values.of({Kind.POINT2: (np.array([key]), place)}))
    return values


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
