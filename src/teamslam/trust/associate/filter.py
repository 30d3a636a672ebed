"""A robot's pose and its landmarks as one Gaussian, carried along its way: an extended Kalman filter.

    move     X' = X Z,   P' = F P F' + G Q G'      Z, Q a step of odometry
    see      e = z (-) h, S = J P J' + 1,  K = P J' S^-1

It serves to say which sighting may be of which landmark, with all correlations; the map itself is the business of least
squares.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from teamslam.geometry import Array, IntArray, Pose, concatenate, rotations
from teamslam.joining.start.targets import place_targets
from teamslam.model import Kind, Layout, Table, Values, pose_kind
from teamslam.trust.associate.sensing import Slopes, slopes

HERE = -2  # the key that the pose has in the filter; landmarks are 0, 1, 2, ...


class Filter:
    """The belief: `pose` (1,), `marks` (n,) of one kind, and their covariance, pose first."""

    def __init__(self, dim: int, kind: Kind) -> None:
        self.kind = kind
        self.pose = Pose.identity(dim, (1,))
        self.marks: Pose | Array = Pose.identity(kind.dim, (0,)) if kind.is_pose else np.zeros((0, kind.dim))
        self.covariance = np.zeros((self.pose.dof, self.pose.dof))
        self.count = 0

    def move(self, step: Pose, noise: Array) -> None:
        """One step of odometry (1,), with its covariance."""
        d, group = self.pose.dim, rotations(self.pose.dim)
        R, z = self.pose.rotation[0], step.translation[0]
        F, G = np.eye(self.pose.dof), np.eye(self.pose.dof)
        for k, axis in enumerate(np.eye(group.DOF)):
            F[:d, d + k] = R @ group.hat(axis) @ z
        F[d:, d:] = group.adjoint(step.rotation[0].T)
        G[:d, :d] = R
        n, P = self.pose.dof, self.covariance.copy()
        P[:n] = F @ P[:n]
        P[:, :n] = P[:, :n] @ F.T
        P[:n, :n] += G @ noise @ G.T
        self.pose, self.covariance = self.pose @ step, P

    def values(self) -> Values:
        """The estimate; the pose is called HERE."""
        parts: dict[Kind, tuple[IntArray, Pose | Array]] = {}
        parts[self.kind] = np.arange(self.count), self.marks
        here = np.array([HERE]), self.pose
        kind = pose_kind(self.pose.dim)
        if kind == self.kind:
            assert isinstance(self.marks, Pose)
            parts[kind] = np.append(here[0], parts[kind][0]), concatenate([self.pose, self.marks])
        else:
            parts[kind] = here
        return Values.of({k: p for k, p in parts.items() if len(p[0])})

    def seen(self, rows: Sequence[tuple[IntArray, Table]], targets: IntArray) -> "Innovations":
        """Residuals of sightings of `targets` (k,), with the covariance that they should have."""
        return Innovations(slopes(rows, self.values(), len(targets)), targets, self.covariance)

    def update(self, seen: "Innovations", shares: Sequence[Mapping[int, float]]) -> None:
        """Believe some sightings: of each, the pairs that it may be, with how likely they are beside the first. Where
        there are several, their mean counts, with their spread as noise (probabilistic data association)."""
        J, e, noise = seen.blended(shares)
        PJ = self.covariance @ J.T
        gain = np.linalg.solve(J @ PJ + noise, PJ.T).T
        self._shift(gain @ e)
        left = np.eye(len(self.covariance)) - gain @ J
        self.covariance = left @ self.covariance @ left.T + gain @ noise @ gain.T

    def add(self, row: Table) -> int:
        """A new landmark where one sighting says (observer HERE); its number."""
        number, n, q = self.count, self.pose.dof, self.kind.dof
        row = replace(row, keys=np.array([[HERE, number]]))
        here = self.values().only(np.array([HERE]))
        kinds = np.array([pose_kind(self.pose.dim), self.kind])
        placed = place_targets(here, [row], Layout.of(np.array([HERE, number]), kinds))
        new = placed.gather(np.array([number]), self.kind)
        if isinstance(self.marks, Pose):
            assert isinstance(new, Pose)
            self.marks = concatenate([self.marks, new])
        else:
            assert not isinstance(new, Pose)
            self.marks = np.concatenate([self.marks, new])
        self.count += 1
        found = slopes([(np.array([0]), row)], placed, 1)
        inverse = np.linalg.pinv(found.of_target[0])
        back = -inverse @ found.of_pose[0]
        size = len(self.covariance)
        grown = np.zeros((size + q, size + q))
        grown[:size, :size] = self.covariance
        grown[size:, :size] = back @ self.covariance[:n]
        grown[:size, size:] = grown[size:, :size].T
        grown[size:, size:] = back @ self.covariance[:n, :n] @ back.T + inverse @ inverse.T
        self.covariance = grown
        return number

    def _shift(self, delta: Array) -> None:
        n = self.pose.dof
        self.pose = self.pose.retract(delta[None, :n])
        moved = delta[n:].reshape(self.count, self.kind.dof)
        self.marks = self.marks.retract(moved) if isinstance(self.marks, Pose) else self.marks + moved


class Innovations:
    """Residuals of candidate sightings (k, r), of `targets` (k,) by number, from one pose, with the covariance S
    (k, r, r) that they should have by that of the pose and all landmarks together."""

    def __init__(self, found: Slopes, targets: IntArray, covariance: Array, rarity: Array | None = None) -> None:
        """`rarity` (k,): -2 log of how likely each pair is before its residual is looked at, but for a constant."""
        self.rarity = np.zeros(len(targets)) if rarity is None else rarity
        n, q = found.of_pose.shape[2], found.of_target.shape[2]
        pose = np.broadcast_to(np.arange(n), (len(targets), n))
        self.error, self.rank, self.targets, self.covariance = found.error, found.rank, targets, covariance
        self.at = np.concatenate([pose, n + q * targets[:, None] + np.arange(q)], 1)
        self.A = np.concatenate([found.of_pose, found.of_target], 2)
        inner = covariance[self.at[:, :, None], self.at[:, None, :]]
        self.S = self.A @ inner @ np.swapaxes(self.A, 1, 2) + np.eye(self.A.shape[1])

    @property
    def distance(self) -> Array:
        """Squared Mahalanobis distances e' S^-1 e (k,)."""
        return np.asarray(np.sum(self.error * np.linalg.solve(self.S, self.error[..., None])[..., 0], -1))

    def stacked(self, chosen: IntArray) -> tuple[Array, Array]:
        """The Jacobian (rows, size) and residual (rows,) of several together."""
        r = self.error.shape[1]
        J = np.zeros((len(chosen) * r, len(self.covariance)))
        for k, which in enumerate(chosen.tolist()):
            J[k * r : (k + 1) * r, self.at[which]] = self.A[which]
        return J, self.error[chosen].ravel()

    def blended(self, shares: Sequence[Mapping[int, float]]) -> tuple[Array, Array, Array]:
        """The Jacobian, residual and noise of several sightings together, each a blend of pairs."""
        first = np.array([next(iter(share)) for share in shares])
        J, e = self.stacked(first)
        r = self.error.shape[1]
        noise = np.eye(len(e))
        for k, share in enumerate(shares):
            if len(share) > 1:
                weight = np.array(list(share.values())) / sum(share.values())
                error = self.error[list(share)]
                rows = slice(k * r, (k + 1) * r)
                e[rows] = weight @ error
                noise[rows, rows] += (weight[:, None] * (error - e[rows])).T @ (error - e[rows])
        return J, e, noise

    def together(self, chosen: IntArray) -> tuple[float, float]:
        """The squared Mahalanobis distance of several at once, and their -2 log likelihood but for a constant."""
        at = np.unique(self.at[chosen])
        J, e = self.stacked(chosen)
        J = J[:, at]
        S = J @ self.covariance[np.ix_(at, at)] @ J.T + np.eye(len(e))
        distance = float(e @ np.linalg.solve(S, e))
        return distance, distance + float(np.linalg.slogdet(S)[1]) + float(self.rarity[chosen].sum())
