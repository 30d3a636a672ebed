"""Where a flat body is whose four points are seen in four directions: a tag, by its corners.

    sight:   u_k ~ R c_k + T, points c_k in a plane of the body, directions u_k of unit length, k = 1..4
    start:   the plane's homography, u_k x (H p_k) = 0 with p_k the points in the plane, H = [r1 r2 T] up to a factor
    mirror:  seen from far, a plane leaned the other way looks the same: R' = M R (with the normal turned back, so that
             it is a rotation), M = 1 - 2 d d' the mirror across the line of sight d
    refine:  Gauss-Newton on the directions, from both; they may end at one pose, or at two that fit nearly alike

Directions instead of image coordinates: so a fisheye's corner beyond 90 degrees is like any other.
Source: Collins, Bartoli, "Infinitesimal plane-based pose estimation", IJCV 109 (2014), for why there are two.
"""

from dataclasses import dataclass

import numpy as np

from teamslam.geometry import s2, so3
from teamslam.geometry.arrays import Array
from teamslam.geometry.pose import Pose

STEPS = 12
STANDS = 1e-12  # of the cost: what a step still promises where a pose stands
SAME = 1e-3  # two poses nearer than this (of the distance, and in radians) are one


@dataclass(frozen=True, eq=False)
class Resection:
    """Poses of the body in the observer's frame: `poses` (m, 2), the better first; `costs` (m, 2), squared whitened
    residuals, infinite for a second that is the first again or lies behind the observer."""

    poses: Pose
    costs: Array


def resect(rays: Array, points: Array, whitening: Array) -> Resection:
    """The poses of flat bodies from rays (m, 4, 3) to their points (m, 4, 3), which lie in a plane of each.

    `whitening` (m, 8, 8) or (1, 8, 8) of the directions, two numbers each in the axes of `s2`. Law: rays to
    X.act(points) give X where the points span a plane and none is at the observer.
    """
    middle = points.mean(1)
    points = points - middle[:, None]
    first = _started(rays, points)
    both = [_refined(start, rays, points, whitening) for start in (first, mirrored(first))]
    poses = Pose(*(np.stack(parts, 1) for parts in zip(*((p.rotation, p.translation) for p, _ in both), strict=True)))
    costs = np.stack([cost for _, cost in both], 1)
    behind = np.sum(rays.mean(1)[:, None] * poses.translation, -1) <= 0.0
    costs = np.where(behind & ~behind.all(1, keepdims=True), np.inf, costs)
    order = np.argsort(costs, axis=1, kind="stable")
    each = np.arange(len(costs))[:, None]
    poses, costs = Pose(poses.rotation[each, order], poses.translation[each, order]), costs[each, order]
    off = poses[:, 0].minus(poses[:, 1])
    distance = np.linalg.norm(poses.translation[:, 0], axis=-1)
    one = (np.linalg.norm(off[:, :3], axis=-1) < SAME * distance) & (np.linalg.norm(off[:, 3:], axis=-1) < SAME)
    costs[:, 1] = np.where(one, np.inf, costs[:, 1])
    back = (poses.rotation @ middle[:, None, :, None])[..., 0]
    return Resection(Pose(poses.rotation, poses.translation - back), costs)


def nearest(start: Pose, rays: Array, points: Array, whitening: Array) -> Pose:
    """The poses (m,) to which those of `start` (m,) lead, for rays that are little else than those it was made of; the
    rest as in `resect`."""
    middle = points.mean(1)
    about = Pose(start.rotation, start.act(middle))
    found, _ = _refined(about, rays, points - middle[:, None], whitening)
    return Pose(found.rotation, found.translation - (found.rotation @ middle[..., None])[..., 0])


def slopes(pose: Pose, rays: Array, points: Array) -> tuple[Array, Array]:
    """The residual of the directions (m, 8) and J = -de/d[T, w] (m, 8, 6), to first order in the residual."""
    seen = points @ np.swapaxes(pose.rotation, -1, -2) + pose.translation[:, None]
    distance = np.linalg.norm(seen, axis=-1)[..., None]
    unit = seen / np.maximum(distance, 1e-12)
    error = s2.minus(rays, unit)
    basis = np.swapaxes(s2.direction_basis(rays), -1, -2)
    across = (basis - (basis @ unit[..., None]) * unit[..., None, :]) / np.maximum(distance, 1e-12)[..., None]
    turning = -pose.rotation[:, None] @ so3.hat(points)
    jacobian = np.concatenate([across, across @ turning], -1)
    return error.reshape(-1, 8), jacobian.reshape(-1, 8, 6)


def _started(rays: Array, points: Array) -> Pose:
    """From the homography between the plane of the points, which are about their middle, and the rays."""
    along = _unit(points[:, 1] - points[:, 0])
    normal = _unit(np.cross(along, points[:, 3] - points[:, 0]))
    plane = np.stack([along, np.cross(normal, along), normal], -1)  # of the plane's axes in the body's
    flat = points @ plane
    size = np.maximum(np.linalg.norm(flat, axis=-1).mean(-1), 1e-300)[:, None, None]
    flat = np.concatenate([flat[..., :2] / size, np.ones((*flat.shape[:2], 1))], -1)
    rows = (so3.hat(rays)[..., :, None] * flat[:, :, None, None, :]).reshape(len(rays), 12, 9)
    H = np.linalg.svd(rows)[2][:, 8].reshape(-1, 3, 3)
    ahead = np.sum((flat @ np.swapaxes(H, -1, -2)) * rays, -1).sum(-1)
    H = H * np.where(ahead < 0.0, -1.0, 1.0)[:, None, None]
    scale = 0.5 * (np.linalg.norm(H[..., 0], axis=-1) + np.linalg.norm(H[..., 1], axis=-1))
    H = H / np.maximum(scale, 1e-300)[:, None, None]
    third = np.cross(H[..., 0], H[..., 1])
    u, _, vt = np.linalg.svd(np.stack([H[..., 0], H[..., 1], third], -1))
    u[..., 2] *= np.linalg.det(u @ vt)[:, None]
    seen = Pose(u @ vt, H[..., 2] * size[:, 0])
    return Pose(seen.rotation @ np.swapaxes(plane, -1, -2), seen.translation)


def mirrored(pose: Pose) -> Pose:
    """The pose that looks alike from far: leaned the other way about the line of sight to the body's middle."""
    distance = np.maximum(np.linalg.norm(pose.translation, axis=-1, keepdims=True), 1e-12)
    sight = pose.translation / distance
    mirror = np.eye(3) - 2.0 * sight[..., :, None] * sight[..., None, :]
    return Pose(mirror @ pose.rotation @ np.diag([1.0, 1.0, -1.0]), pose.translation)


def _refined(pose: Pose, rays: Array, points: Array, whitening: Array) -> tuple[Pose, Array]:
    """The nearest optimum of each, and its cost (m,): each moves until it stands."""
    whitening = np.broadcast_to(whitening, (len(rays), 8, 8))
    rotation, translation = pose.rotation.copy(), pose.translation.copy()
    error, jacobian = slopes(pose, rays, points)
    cost, damping = _cost(whitening, error), np.full(len(rays), 1e-4)
    at = np.arange(len(rays))
    for _ in range(STEPS):
        J, e = whitening[at] @ jacobian[at], whitening[at] @ error[at, :, None]
        down, normal = np.swapaxes(J, -1, -2) @ e, np.swapaxes(J, -1, -2) @ J
        scale = np.einsum("mii->mi", normal)
        floor = damping[at, None] * scale + 1e-12 * scale.max(-1, keepdims=True) + 1e-30
        step = np.linalg.solve(normal + floor[..., None] * np.eye(6), down)[..., 0]
        tried = Pose(rotation[at], translation[at]).retract(step)
        error_tried, jacobian_tried = slopes(tried, rays[at], points[at])
        cost_tried = _cost(whitening[at], error_tried)
        better = cost_tried < cost[at]
        damping[at] *= np.where(better, 0.1, 10.0)
        new = at[better]
        rotation[new], translation[new] = tried.rotation[better], tried.translation[better]
        error[new], jacobian[new], cost[new] = error_tried[better], jacobian_tried[better], cost_tried[better]
        at = at[~(np.sum(step * down[..., 0], -1) < STANDS * (1.0 + cost[at]))]
        if not len(at):
            break
    return Pose(rotation, translation), cost


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-300))


def _cost(whitening: Array, error: Array) -> Array:
    return np.asarray(np.sum((whitening @ error[..., None])[..., 0] ** 2, -1))
