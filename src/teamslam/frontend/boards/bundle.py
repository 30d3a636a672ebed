"""A camera and the board's poses from many views, by least squares.

    pixel(view i, corner k) = project(camera; X_i . c_k(board)) + noise

Unknown are the camera's numbers, the pose X_i of the board in each view, and, where asked, in what the board differs
from what is stated:  c(s, a, b, c) = (x, (1 + s) y, a x^2 + b x y + c y^2),  stretched one way and bent. (One scale
for both ways cannot be seen.) Levenberg-Marquardt; the poses are eliminated view by view. With S the information of
the camera's numbers and g_i what view i pulls at them, in pixels:

    formal      s^2 S^-1,  s^2 what is left a number: every corner errs by itself
    by views    S^-1 (sum g_i g_i') S^-1 n / (n - p):  corners of one view may err together (the sandwich)

OpenCV's solvers do the first of these for radial-tangential cameras; for `equidistant` its solver stops at the first
view that is badly conditioned, it frees no board but one that is seen whole, and it gives no covariance by views.
"""

from dataclasses import dataclass, replace

import numpy as np

from teamslam.errors import InputError
from teamslam.frontend.boards.find import FEWEST, Views
from teamslam.frontend.tags.camera import Camera
from teamslam.geometry import Array, Pose, concatenate, so3
from teamslam.geometry.resection import resect

NUMBERS = {"radtan": (5, 8), "equidistant": (4,)}
LENSES = (0.35, 0.7, 1.4, 2.8)  # focal lengths that are tried first, by the width of the image
TRIED = 8  # views for these
STEPS, ENOUGH = 60, 1e-7  # at most, and the share of the cost that the last two may still gain
STEP = 1e-6
WILD = 3.0  # a priori sigma of each number of distortion: where views leave one open it stays in reach
BETTER = 2.0  # times: as much less must another pose of a view cost, to be taken
FAR = 8.0  # robust sigmas beyond which a corner is no corner


@dataclass(frozen=True, eq=False)
class Fit:
    """What fits some views best: the camera; the board's `stretch` and `bend` (3,) [1/m] as above, zeros where it was
    taken as stated; its poses (n,) in the camera; residuals (m, 2) [pixels] of the corners of `views`. `covariance` is
    that of the camera's numbers (fx, fy, cx, cy, distortion, then stretch and bend), `by_views` the same from the views
    as wholes."""

    camera: Camera
    stretch: float
    bend: Array
    poses: Pose
    views: Views
    residuals: Array
    covariance: Array
    by_views: Array

    @property
    def focal(self) -> float:
        """The focal length, one for both directions (their geometric mean) [pixels]."""
        return float(np.sqrt(self.camera.focal[0] * self.camera.focal[1]))

    @property
    def formal_sigma(self) -> float:
        """Of `focal` [pixels], were each corner to err by itself."""
        return self._sigma(self.covariance)

    @property
    def sigma_by_views(self) -> float:
        """Of `focal` [pixels], from the views as wholes."""
        return self._sigma(self.by_views)

    @property
    def rms(self) -> float:
        """What is left of a corner [pixels], both directions together."""
        return float(np.sqrt(np.mean(np.sum(self.residuals**2, -1))))

    @property
    def sigmas(self) -> Array:
        """Of the camera's numbers, the larger of both."""
        return np.sqrt(np.maximum(np.diag(self.covariance), np.diag(self.by_views)))

    def poses_of(self, views: Views) -> Pose:
        """The board's poses in some of the views."""
        return self.poses[np.searchsorted(self.views.frames, views.frames)]

    def _sigma(self, covariance: Array) -> float:
        slope = 0.5 * self.focal / np.array(self.camera.focal)
        return float(np.sqrt(slope @ covariance[:2, :2] @ slope))


def fit(views: Views, points: Array, model: str, numbers: int, *, loose: bool = False, start: Fit | None = None) -> Fit:
    """The camera of `model` with so many numbers of distortion that fits the views best, and the board's poses;
    `loose` frees the board, `start` is a fit to these views, and perhaps others. InputError where nothing does."""
    if start is None:
        first = _first(views, points, model, numbers)
        state = _State(first.with_board(loose), _posed(first.camera(), views, points))
    else:
        theta = _Numbers.of(start.camera, numbers, views.size, start.stretch, start.bend).with_board(loose)
        state = _State(theta, start.poses_of(views))
    state = _solved(state, views, points, STEPS)
    if (again := _posed_again(state, views, points)) is not None:  # by a rough camera a view may end in a wrong pose
        state = _solved(again, views, points, STEPS)
    error = _residuals(state, views, points)
    covariance, by_views = _covariances(state, views, points)
    stretch, bend = state.theta.board
    return Fit(
        state.theta.camera(),
        stretch,
        bend,
        state.poses,
        views,
        error,
        covariance,
        by_views,
    )


def as_read(found: Fit) -> Views:
    """The views of a fit without corners that are none: farther off than FAR times the usual, and half a pixel. Views
    that keep fewer than FEWEST are left out as wholes."""
    size = np.linalg.norm(found.residuals, axis=-1)
    kept = found.views.without(size > max(FAR * float(np.median(size)), 0.5))
    return kept.select(np.bincount(kept.view, minlength=len(kept)) >= FEWEST)


def left_by(known: Fit, near: Pose, views: Views, points: Array) -> Array:
    """What the camera (and board) of a fit leaves of each of other views (n,): the mean square of a corner [pixels^2],
    the board's poses refined from `near`."""
    theta = _Numbers.of(known.camera, len(known.camera.distortion), views.size, known.stretch, known.bend)
    state = _solved(_State(theta, near), views, points, STEPS, only_poses=True)
    error = _residuals(state, views, points)
    square = np.minimum(np.sum(error**2, -1), FAR**2 * np.median(np.sum(error**2, -1)))
    return np.asarray(np.bincount(views.view, square, len(views)) / np.bincount(views.view, minlength=len(views)))


# --- what is unknown ----------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Numbers:
    """The numbers of camera and board as one array: fx, fy, cx, cy, distortion, and stretch and bend where free."""

    model: str
    size: tuple[int, int]
    values: Array
    count: int  # of the distortion's
    free: bool = False

    @classmethod
    def of(cls, camera: Camera, count: int, size: tuple[int, int], stretch: float, bend: Array) -> "_Numbers":
        known = [*camera.distortion, *([0.0] * 8)][:count]
        return cls(
            camera.model, size, np.array([*camera.focal, *camera.centre, *known, stretch, *bend], float), count, True
        )

    def with_board(self, free: bool) -> "_Numbers":
        values = np.concatenate([self.values[: 4 + self.count], self.values[4 + self.count :] if self.free else []])
        if free and not self.free:
            values = np.concatenate([values, np.zeros(4)])
        return replace(self, values=values if free else values[: 4 + self.count], free=free)

    def moved(self, step: Array) -> "_Numbers":
        return replace(self, values=self.values + step)

    def camera(self) -> Camera:
        fx, fy, cx, cy, *k = self.values[: 4 + self.count].tolist()
        return Camera((fx, fy), (cx, cy), self.model, tuple(k), self.size)

    @property
    def board(self) -> tuple[float, Array]:
        rest = self.values[4 + self.count :] if self.free else np.zeros(4)
        return float(rest[0]), rest[1:]

    @property
    def scales(self) -> Array:
        """What a small change of each number is: of lengths in pixels a part of the image, of others a part of 1."""
        width = float(self.size[0])
        return np.array([width] * 4 + [1.0] * (len(self.values) - 4))

    @property
    def prior(self) -> Array:
        """The information that is taken for granted about each: of distortion only."""
        known = np.zeros(len(self.values))
        known[4 : 4 + self.count] = WILD**-2
        return known


@dataclass(frozen=True, eq=False)
class _State:
    theta: _Numbers
    poses: Pose


def _shaped(points: Array, stretch: float, bend: Array) -> Array:
    x, y = points[..., 0], points[..., 1]
    return np.stack([x, (1.0 + stretch) * y, points[..., 2] + bend[0] * x * x + bend[1] * x * y + bend[2] * y * y], -1)


def _residuals(state: _State, views: Views, points: Array) -> Array:
    """Measured less predicted (m, 2) [pixels]; far off where a point is behind the camera."""
    bent = _shaped(points, *state.theta.board)[views.corner]
    seen = state.poses[views.view].act(bent)
    at = state.theta.camera().project(seen)
    return np.asarray(np.where(np.isfinite(at), views.pixels - at, 1e4))


# --- starting -----------------------------------------------------------------------------------------------------


def _first(views: Views, points: Array, model: str, numbers: int) -> _Numbers:
    """The best of some lenses, each refined on a few views."""
    few = views.select(np.unique(np.linspace(0, len(views) - 1, min(TRIED, len(views))).astype(int)))
    width, height = views.size
    best: tuple[float, _Numbers] | None = None
    for lens in LENSES:
        camera = Camera((lens * width,) * 2, (0.5 * (width - 1), 0.5 * (height - 1)), model, (0.0,) * 4, views.size)
        theta = _Numbers.of(camera, 4, views.size, 0.0, np.zeros(3)).with_board(False)
        try:
            state = _solved(_State(theta, _posed(camera, few, points)), few, points, 15)
        except (InputError, np.linalg.LinAlgError):
            continue
        cost = float(np.median(np.sum(_residuals(state, few, points) ** 2, -1)))
        if best is None or cost < best[0]:
            best = cost, state.theta
    if best is None:
        raise InputError(f"no {model} camera fits these views; are board and its sizes as stated?")
    theta = best[1]
    values = np.concatenate([theta.values, np.zeros(numbers - theta.count)])
    return replace(theta, values=values, count=numbers)


def _posed(camera: Camera, views: Views, points: Array) -> Pose:
    """The board's pose in each view: by four of its corners that span it most, then by all; the better of the two that
    a flat board may have."""
    quads = np.array([_spread(views.corner[views.view == k], points) for k in range(len(views))])
    at = np.array([views.pixels[views.view == k][q] for k, q in enumerate(quads)])
    of = np.array([views.corner[views.view == k][q] for k, q in enumerate(quads)])
    rays, _ = camera.rays(at)
    two = resect(rays, points[of], np.eye(8)[None]).poses
    theta = _Numbers.of(camera, len(camera.distortion), views.size, 0.0, np.zeros(3))
    costs, each = [], []
    for k in range(2):
        state = _solved(_State(theta, two[:, k]), views, points, 12, only_poses=True)
        each.append(state.poses)
        square = np.sum(_residuals(state, views, points) ** 2, -1)
        costs.append(np.bincount(views.view, square, len(views)))
    better = np.argmin(costs, 0)
    return concatenate([each[k][[n]] for n, k in enumerate(better.tolist())])


def _posed_again(state: _State, views: Views, points: Array) -> _State | None:
    """The state with other poses of the views that fit much better there by its own camera; None where none does."""
    other = _State(state.theta, _posed(state.theta.camera(), views, points))
    costs = [
        np.bincount(views.view, np.sum(_residuals(each, views, points) ** 2, -1), len(views)) for each in (state, other)
    ]
    better = BETTER * costs[1] < costs[0]
    if not better.any():
        return None
    poses = [(other if there else state).poses[[n]] for n, there in enumerate(better.tolist())]
    return _State(state.theta, concatenate(poses))


def _spread(corners: Array, points: Array) -> Array:
    """Four of the corners of a view, around it: the most extreme along four directions at right angles, turned until
    all four differ and span something."""
    flat = points[corners, :2] - points[corners, :2].mean(0)
    best, most = np.zeros(4, np.int64), -1.0
    for angle in (0.0, np.pi / 8, np.pi / 4, 3 * np.pi / 8):
        ways = np.array([[np.cos(angle + k * np.pi / 2), np.sin(angle + k * np.pi / 2)] for k in range(4)])
        quad = np.argmax(flat @ ways.T, 0)
        x, y = flat[quad].T
        area = 0.5 * abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) if len(set(quad.tolist())) == 4 else 0.0
        if area > most:
            best, most = quad, float(area)
    return np.asarray(best)


# --- solving ------------------------------------------------------------------------------------------------------


def _solved(state: _State, views: Views, points: Array, steps: int, *, only_poses: bool = False) -> _State:
    """The nearest optimum, by Levenberg-Marquardt. InputError where numbers run away."""
    error = _residuals(state, views, points)
    prior = state.theta.prior
    cost = _cost(error, state.theta, prior)
    damping, gained = 1e-3, np.inf
    for _ in range(steps):
        A, B, C, a, c = _normal(state, error, views, points, only_poses=only_poses)
        A, a = A + np.diag(prior), a.sum(0) - prior * state.theta.values
        for _ in range(12):
            step, moves = _step(A, B, C, a, c, damping, only_poses)
            try:
                tried = _State(state.theta.moved(step), state.poses.retract(moves))
                error_tried = _residuals(tried, views, points)
                cost_tried = _cost(error_tried, tried.theta, prior)
            except InputError:  # no camera at all
                cost_tried = np.inf
            if cost_tried < cost:
                break
            damping = min(damping * 10.0, 1e12)
        else:
            return state
        before, gained = gained, (cost - cost_tried) / cost
        state, error, cost, damping = tried, error_tried, cost_tried, max(damping * 0.1, 1e-12)
        if gained < ENOUGH and before < ENOUGH:
            break
    return state


def _cost(error: Array, theta: _Numbers, prior: Array) -> float:
    return float(np.sum(error**2) + np.sum(prior * theta.values**2))


def _normal(
    state: _State, error: Array, views: Views, points: Array, *, only_poses: bool = False
) -> tuple[Array, Array, Array, Array, Array]:
    """Normal equations: A (p, p) of the numbers, B (n, p, 6), C (n, 6, 6) of the poses, right sides a (n, p) of
    each view, c (n, 6). By differences: of the numbers a column each, of the poses all views at once."""
    theta, n = state.theta, len(views)
    scales = STEP * theta.scales
    columns = []
    for k, scale in enumerate([] if only_poses else scales.tolist()):
        d = np.zeros(len(scales))
        d[k] = scale
        ahead = _residuals(_State(theta.moved(d), state.poses), views, points)
        behind = _residuals(_State(theta.moved(-d), state.poses), views, points)
        columns.append((behind - ahead) / (2.0 * scale))
    J = np.stack(columns, -1) if columns else np.zeros((*error.shape, len(scales)))  # (m, 2, p), of what is predicted
    shaped = _shaped(points, *theta.board)[views.corner]
    turning = -state.poses.rotation[views.view] @ so3.hat(shaped)  # a pose moves by [T, w]: T + dT, R exp(w)
    across = _slopes(theta.camera(), state.poses[views.view].act(shaped))
    P = np.concatenate([across, across @ turning], -1)
    start = np.searchsorted(views.view, np.arange(n))

    def by_view(rows: Array) -> Array:
        return np.asarray(np.add.reduceat(rows, start, axis=0))

    return (
        np.einsum("mip,miq->pq", J, J),
        by_view(np.einsum("mip,miq->mpq", J, P)),
        by_view(np.einsum("mip,miq->mpq", P, P)),
        by_view(np.einsum("mip,mi->mp", J, error)),
        by_view(np.einsum("mip,mi->mp", P, error)),
    )


def _slopes(camera: Camera, seen: Array) -> Array:
    """How pixels move (m, 2, 3) with points (m, 3) in the camera; by differences of a part of their distance."""
    step = (STEP * np.linalg.norm(seen, axis=-1))[:, None]
    columns = [(camera.project(seen + step * d) - camera.project(seen - step * d)) / (2.0 * step) for d in np.eye(3)]
    found = np.stack(columns, -1)
    return np.asarray(np.where(np.isfinite(found), found, 0.0))


def _step(A: Array, B: Array, C: Array, a: Array, c: Array, damping: float, only_poses: bool) -> tuple[Array, Array]:
    C = C + damping * np.einsum("nij,ij->nij", C, np.eye(6)) + _floor(C)
    if only_poses:
        return np.zeros(len(A)), np.asarray(np.linalg.solve(C, c[..., None])[..., 0])
    S, s = _reduced(A + damping * np.diag(np.diag(A)), B, C, a, c)
    width = np.sqrt(np.maximum(np.diag(S), 1e-12))
    step = np.linalg.solve(S / width[:, None] / width + 1e-13 * np.eye(len(a)), s / width) / width
    return step, np.asarray(np.linalg.solve(C, (c - np.swapaxes(B, 1, 2) @ step)[..., None])[..., 0])


def _floor(C: Array) -> Array:
    """What keeps the pose of a view that says nothing of it."""
    return np.asarray((1e-9 + 1e-13 * np.einsum("nii->n", C))[:, None, None] * np.eye(6))


def _reduced(A: Array, B: Array, C: Array, a: Array, c: Array) -> tuple[Array, Array]:
    gain = B @ np.linalg.inv(C)
    return A - (gain @ np.swapaxes(B, 1, 2)).sum(0), a - (gain @ c[..., None])[..., 0].sum(0)


def _covariances(state: _State, views: Views, points: Array) -> tuple[Array, Array]:
    """Of the numbers: formal, and by views."""
    error = _residuals(state, views, points)
    A, B, C, a, c = _normal(state, error, views, points)
    n, p = len(views), len(A)
    C = C + _floor(C)
    free = max(error.size - p - 6 * n, 1)
    variance = float(np.sum(error**2)) / free
    S, _ = _reduced(A, B, C, np.zeros(p), np.zeros((n, 6)))
    S = S + variance * np.diag(state.theta.prior)
    width = np.sqrt(np.maximum(np.diag(S), 1e-300))
    inverse = np.linalg.pinv(S / width[:, None] / width, rcond=1e-15, hermitian=True) / width[:, None] / width
    pulls = a - (B @ np.linalg.solve(C, c[..., None]))[..., 0]
    meat = pulls.T @ pulls * n / max(n - p, 1)
    return variance * inverse, inverse @ meat @ inverse
