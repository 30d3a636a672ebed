"""The kernel's oracle: residuals, retraction and linear systems in plain NumPy, written from the definitions.

Slow on purpose: one row at a time, rotations by SciPy, Jacobians by differences.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

NUMBERS = (6, 12, 2, 3)
DOFS = (3, 6, 2, 3)
POSE2, POSE3, POINT2, POINT3 = range(4)
KIND_NAMES = ("pose2", "pose3", "point2", "point3")


# --- random values ------------------------------------------------------------------------------------------------


def rotation(rng, dim):
    if dim == 3:
        return Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
    angle = rng.uniform(-np.pi, np.pi)
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def pose_numbers(rng, dim):
    return np.concatenate([rng.normal(0, 3, dim), rotation(rng, dim).ravel()])


def random_variable(rng, kind):
    if kind in (POSE2, POSE3):
        return pose_numbers(rng, 2 if kind == POSE2 else 3)
    return rng.normal(0, 3, NUMBERS[kind])


# --- poses --------------------------------------------------------------------------------------------------------


def split(x):
    """T (d,), R (d, d) of a pose of 6 or 12 numbers."""
    d = 2 if len(x) == 6 else 3
    return x[:d], x[d:].reshape(d, d)


def lift(x):
    """A pose in space; a planar one becomes yaw only at z = 0."""
    if len(x) == 12:
        return x
    T, R = split(x)
    out = np.eye(3)
    out[:2, :2] = R
    return np.concatenate([T, [0.0], out.ravel()])


def compose(a, b):
    (Ta, Ra), (Tb, Rb) = split(a), split(b)
    return np.concatenate([Ta + Ra @ Tb, (Ra @ Rb).ravel()])


def log(R):
    if len(R) == 2:
        return np.array([np.arctan2(R[1, 0], R[0, 0])])
    return Rotation.from_matrix(R).as_rotvec()


def exp(w):
    if len(w) == 1:
        return np.array([[np.cos(w[0]), -np.sin(w[0])], [np.sin(w[0]), np.cos(w[0])]])
    return Rotation.from_rotvec(w).as_matrix()


def retract(kind, x, delta):
    if kind in (POINT2, POINT3):
        return x + delta
    T, R = split(x)
    d = len(T)
    return np.concatenate([T + delta[:d], (R @ exp(delta[d:])).ravel()])


def minus(a, b):
    """a (-) b of two poses or points of the same numbers."""
    if len(a) < 6:
        return a - b
    (Ta, Ra), (Tb, Rb) = split(a), split(b)
    return np.concatenate([Ta - Tb, log(Rb.T @ Ra)])


# --- models -------------------------------------------------------------------------------------------------------


def tangent_basis(z):
    """Towards rising azimuth and towards rising elevation: the derivatives of z = (cos a cos b, sin a cos b, sin b)."""
    azimuth, elevation = np.arctan2(z[1], z[0]), np.arctan2(z[2], np.hypot(z[0], z[1]))
    east = [-np.sin(azimuth), np.cos(azimuth), 0.0]
    north = [-np.cos(azimuth) * np.sin(elevation), -np.sin(azimuth) * np.sin(elevation), np.cos(elevation)]
    return np.array([east, north]).T


def bearing_residual(z, h):
    if len(h) == 2:
        return np.array([(z[0] - np.arctan2(h[1], h[0]) + np.pi) % (2 * np.pi) - np.pi])
    u = h / np.linalg.norm(h)
    b = tangent_basis(z).T @ u
    angle = np.arctan2(np.linalg.norm(np.cross(z, u)), z @ u)
    return -angle * b / np.linalg.norm(b)


def position_of(x, dim):
    d = len(x) if len(x) < 4 else len(split(x)[0])
    return np.concatenate([x[:d], np.zeros(3 - d)])[:dim]


def residual(model, dim, z, sensor, variables):
    """z (-) h for one row; `variables` are the numbers of its variables."""
    first = variables[0]
    if model == "position":
        if sensor is not None:
            first = compose(lift(first), lift(sensor))
        return z - position_of(first, dim)
    if dim == 3:
        first = lift(first)
    if sensor is not None:
        first = compose(first, sensor)
    if model == "pose":
        return minus(z, first)
    T, R = split(first)
    if model == "corners":
        T2, R2 = split(lift(variables[1]))
        seen = [R.T @ (R2 @ point + T2 - T) for point in z[12:].reshape(4, 3)]
        return np.concatenate([bearing_residual(u, h) for u, h in zip(z[:12].reshape(4, 3), seen, strict=True)])
    if model == "relative_pose":
        second = lift(variables[1]) if dim == 3 else variables[1]
        T2, R2 = split(second)
        return minus(z, np.concatenate([R.T @ (T2 - T), (R.T @ R2).ravel()]))
    h = R.T @ (position_of(variables[1], dim) - T)
    if model == "point":
        return z - h
    distance = np.array([np.linalg.norm(h)])
    if model == "range":
        return z - distance
    if model == "bearing":
        return bearing_residual(z, h)
    assert model == "range_bearing"
    return np.concatenate([z[:1] - distance, bearing_residual(z[1:], h)])


def measurement(rng, model, dim):
    """A random z of a model, far from what any variable would give."""
    if model in ("relative_pose", "pose"):
        return pose_numbers(rng, dim)
    if model == "corners":
        rays = rng.normal(size=(4, 3))
        return np.concatenate([(rays / np.linalg.norm(rays, axis=1, keepdims=True)).ravel(), rng.normal(size=12)])
    direction = rng.normal(size=3)
    bearing = direction / np.linalg.norm(direction) if dim == 3 else rng.uniform(-np.pi, np.pi, 1)
    if model == "bearing":
        return bearing
    if model == "range":
        return rng.uniform(0, 5, 1)
    if model == "range_bearing":
        return np.concatenate([rng.uniform(0, 5, 1), bearing])
    return rng.normal(0, 3, dim)


def combinations():
    """Every (model, dim, kinds) that the kernel relates."""
    in_space, targets = (POSE2, POSE3), (POSE2, POSE3, POINT3)
    out = [("relative_pose", 2, (POSE2, POSE2))]
    out += [(model, 3, (a, b)) for model in ("relative_pose", "corners") for a in in_space for b in in_space]
    for model in ("point", "range", "bearing", "range_bearing"):
        out += [(model, 2, (POSE2, b)) for b in (POSE2, POSE3, POINT2, POINT3)]
        out += [(model, 3, (a, b)) for a in in_space for b in targets]
    out += [("position", 2, (a,)) for a in (POSE2, POSE3, POINT2, POINT3)]
    out += [("position", 3, (a,)) for a in targets]
    out += [("pose", 2, (POSE2,)), ("pose", 3, (POSE2,)), ("pose", 3, (POSE3,))]
    return out


def derivative(f, n, step=5e-4):
    """df/dx (m, n) at 0 by central differences of fourth order."""
    columns = []
    for j in range(n):
        d = np.zeros(n)
        d[j] = step
        columns.append((8 * (f(d) - f(-d)) - (f(2 * d) - f(-2 * d))) / (12 * step))
    return np.array(columns).T


def jacobian(model, dim, z, sensor, kinds, variables):
    """J = -de/dx (r, dofs of all the row's variables)."""
    ends = np.cumsum([DOFS[kind] for kind in kinds])
    at = residual(model, dim, z, sensor, variables)

    def moved(d):
        parts = np.split(d, ends[:-1])
        e = residual(model, dim, z, sensor, [retract(*args) for args in zip(kinds, variables, parts, strict=True)])
        # Angles and rotation vectors may jump by a turn within the step; nothing else moves by more than one.
        return e if np.abs(e - at).max() < 1.0 else np.full_like(e, np.nan)

    return -derivative(moved, int(ends[-1]))


# --- losses -------------------------------------------------------------------------------------------------------


def rho(loss, k, s):
    if loss == "squared":
        return s
    if loss == "huber":
        return np.where(s <= k**2, s, 2 * k * np.sqrt(np.abs(s)) - k**2)
    if loss == "cauchy":
        return k**2 * np.log(1 + s / k**2)
    return k**2 * s / (k**2 + s)


def loss_weight(loss, k, s, step=1e-4):
    """rho'(s), by differences."""
    return (8 * (rho(loss, k, s + step) - rho(loss, k, s - step)) - rho(loss, k, s + 2 * step)
            + rho(loss, k, s - 2 * step)) / (12 * step)  # fmt: skip


# --- problems -----------------------------------------------------------------------------------------------------


@dataclass
class Variables:
    kinds: np.ndarray
    fixed: np.ndarray
    offsets: np.ndarray = field(init=False)
    dof_start: np.ndarray = field(init=False)  # of every variable; free ones only count

    def __post_init__(self):
        self.offsets = np.concatenate([[0], np.cumsum([NUMBERS[k] for k in self.kinds])]).astype(int)
        dofs = [0 if held else DOFS[k] for k, held in zip(self.kinds, self.fixed, strict=True)]
        self.dof_start = np.concatenate([[0], np.cumsum(dofs)]).astype(int)

    def of(self, state, variable):
        return state[self.offsets[variable] : self.offsets[variable + 1]]

    def random_state(self, rng):
        return np.concatenate([random_variable(rng, kind) for kind in self.kinds])

    def columns(self, members):
        """For every unknown of these variables its column in H, -1 for those held."""
        out = []
        for v in members:
            start = self.dof_start[v]
            out += [-1] * DOFS[self.kinds[v]] if self.fixed[v] else range(start, start + DOFS[self.kinds[v]])
        return np.array(out)


def add_row(variables, members, A, Ae, Aw, H, g):
    """H += A'Aw and g += A'Ae at the columns of the members."""
    columns = variables.columns(members)
    keep = columns >= 0
    H[np.ix_(columns[keep], columns[keep])] += (A.T @ Aw)[np.ix_(keep, keep)]
    g[columns[keep]] += (A.T @ Ae)[keep]


def dense(pattern, values):
    """The whole symmetric matrix."""
    n = pattern.scalars
    out = np.zeros((n, n))
    for c in range(len(pattern.dofs)):
        for k in range(pattern.column_start[c], pattern.column_start[c + 1]):
            r = pattern.row[k]
            rows = slice(pattern.scalar_start[r], pattern.scalar_start[r + 1])
            columns = slice(pattern.scalar_start[c], pattern.scalar_start[c + 1])
            block = values[pattern.value_start[k] : pattern.value_start[k + 1]]
            block = block.reshape(pattern.dofs[c], pattern.dofs[r]).T
            out[columns, rows] = block.T
            out[rows, columns] = block
    return out


def on_pattern(pattern, matrix):
    """The values of a dense symmetric matrix on a pattern."""
    values = np.zeros(pattern.size)
    for c in range(len(pattern.dofs)):
        for k in range(pattern.column_start[c], pattern.column_start[c + 1]):
            r = pattern.row[k]
            rows = slice(pattern.scalar_start[r], pattern.scalar_start[r + 1])
            columns = slice(pattern.scalar_start[c], pattern.scalar_start[c + 1])
            values[pattern.value_start[k] : pattern.value_start[k + 1]] = matrix[rows, columns].T.ravel()
    return values
