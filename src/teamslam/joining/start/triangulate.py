"""Landmarks that no single sighting fixes: placed from several bearings or ranges, in closed form.

Bearings: the point nearest to all rays, a linear least squares: sum |(1 - u u')(p - c)|^2 with sensors at c, unit rays
u. Ranges: differences of |p - c|^2 = r^2 are linear in p (spherical intersection); without spread there is no answer.
A landmark that stays open is left out, and so are its measurements; the caller reports them.
"""

from collections.abc import Sequence

import numpy as np

from teamslam.geometry import Array, IntArray, Pose
from teamslam.joining.start.dead_reckoning import place_targets
from teamslam.model import Kind, Layout, Table, Values, is_landmark, point_kind


def triangulate(start: Values, tables: Sequence[Table]) -> Values:
    """`start` with the landmarks added that its poses see in `tables`, wherever the geometry fixes them."""
    marks = [t.select(is_landmark(t.keys[:, -1])) for t in tables if not t.row.unary]
    marks = [t for t in marks if len(t)]
    wanted = [(t.keys[:, -1], np.full(len(t), int(point_kind(t.dim)))) for t in marks]
    if not wanted:
        return start
    keys, kinds = (np.concatenate(column) for column in zip(*wanted, strict=True))
    new = ~start.layout.contains(keys)
    if not new.any():
        return start
    layout = start.layout.union(Layout.of(keys[new], kinds[new]))
    start = place_targets(start, marks, layout)
    found: dict[Kind, list[tuple[int, Array]]] = {}
    for key in np.unique(keys[~start.layout.contains(keys)]).tolist():
        place = _intersect([t.select(t.keys[:, -1] == key) for t in marks], start)
        if place is not None:
            found.setdefault(point_kind(len(place)), []).append((key, place))
    parts: dict[Kind, tuple[IntArray, Pose | Array]] = {
        kind: (np.array([k for k, _ in points]), np.stack([p for _, p in points])) for kind, points in found.items()
    }
    return start.update(Values.of(parts)) if parts else start


def _intersect(tables: Sequence[Table], values: Values) -> Array | None:
    """The point that several bearings and ranges to it agree on, or None where they leave it open."""
    rows, right, centres, ranges = [], [], [], []
    for table in tables:
        part = table.select(values.layout.contains(table.keys[:, 0]))
        if not len(part):
            continue
        dim = part.dim
        eyes = values.poses_of(part.keys[:, 0], dim)
        eyes = eyes if part.sensor is None else eyes @ part.sensor.lift(dim)
        if part.model == "bearing":
            z = part.values
            ray = np.stack([np.cos(z[:, 0]), np.sin(z[:, 0])], -1) if dim == 2 else z
            ray = (eyes.rotation @ ray[..., None])[..., 0]
            across = np.eye(dim) - ray[:, :, None] * ray[:, None, :]
            rows += list(across)
            right += list((across @ eyes.translation[..., None])[..., 0])
        elif part.model == "range":
            centres += list(eyes.translation)
            ranges += part.values[:, 0].tolist()
    if len(centres) >= 2:
        c, r = np.array(centres), np.array(ranges)
        rows += list((2.0 * (c[1:] - c[0]))[:, None, :])
        right += list((r[0] ** 2 - r[1:] ** 2 + np.sum(c[1:] ** 2, -1) - np.sum(c[0] ** 2))[:, None])
    if not rows:
        return None
    a, b = np.concatenate(rows), np.concatenate(right)
    u, s, vt = np.linalg.svd(a, full_matrices=False)
    if len(s) < a.shape[1] or s[-1] < 1e-3 * s[0]:
        return None
    return np.asarray(vt.T @ ((u.T @ b) / s))
