"""Poses of the plane and of space, any batch, written once.

Conventions, stated here and used everywhere:

- A pose X = (R, T) maps body to world: p_world = R p_body + T.
- Chart ("mixed"): X (+) [dT, dw] = (R Exp(dw), T + dT). The translation is additive in the frame that the pose is
  written in, the rotation is perturbed on the right. Tangent order: translation first.
- a (-) b = [aT - bT ; Log(bR' aR)], so that (b (+) d) (-) b = d exactly.
- `between`: X1.between(X2) = X1^-1 X2 is X2 seen from X1.

Other programs choose otherwise (GTSAM and JRL perturb with the full right SE(n) exponential; g2o turns the translation
error into the measured frame); the readers of their files convert, and say so.
"""

from dataclasses import dataclass
from types import ModuleType

import numpy as np

from teamslam.errors import ModelError
from teamslam.geometry import s1, s2, so2, so3
from teamslam.geometry.arrays import Array, IntArray, Sealed, seal


def rotations(dim: int) -> ModuleType:
    """The rotation group of the plane (2) or of space (3): the module `so2` or `so3`."""
    if dim == 2:
        return so2
    if dim == 3:
        return so3
    raise ModelError(f"a pose lives in the plane (2) or in space (3), found dimension {dim}")


def directions(dim: int) -> ModuleType:
    """The directions of the plane (2) or of space (3): the module `s1` or `s2`."""
    rotations(dim)
    return s1 if dim == 2 else s2


@dataclass(frozen=True, eq=False)
class Pose(Sealed):
    """Rigid body poses: `rotation` (..., d, d), `translation` (..., d) [m], body to world, d = 2 or 3."""

    rotation: Array
    translation: Array

    def __post_init__(self) -> None:
        if self.rotation.shape != (*self.translation.shape, self.translation.shape[-1]):
            raise ModelError(
                f"a pose needs rotation (..., d, d) and translation (..., d) with one batch shape, "
                f"found {self.rotation.shape} and {self.translation.shape}"
            )
        rotations(self.dim)
        seal(self, "rotation", "translation")

    def __repr__(self) -> str:
        if self.batch:
            return f"Pose({' x '.join(map(str, self.batch))} of {'the plane' if self.dim == 2 else 'space'})"
        return f"Pose({', '.join(f'{number:.6g}' for number in self.numbers().tolist())})"

    # --- making poses -------------------------------------------------------------------------------------------

    @classmethod
    def identity(cls, dim: int, batch: tuple[int, ...] = ()) -> "Pose":
        """The pose (I, 0), repeated over a batch shape."""
        return cls(np.broadcast_to(np.eye(dim), (*batch, dim, dim)).copy(), np.zeros((*batch, dim)))

    @classmethod
    def from_xytheta(cls, xytheta: Array) -> "Pose":
        """Planar poses from (..., 3): x, y [m], heading [rad, anticlockwise]."""
        xytheta = np.asarray(xytheta, float)
        return cls(so2.exp(xytheta[..., 2:]), xytheta[..., :2].copy())

    @classmethod
    def from_quaternion(cls, positions_xyz: Array, quaternions_wxyz: Array) -> "Pose":
        """Spatial poses from positions (..., 3) and quaternions (..., 4), scalar first; normalised here."""
        q = np.asarray(quaternions_wxyz, float)
        norm = np.linalg.norm(q, axis=-1, keepdims=True)
        if not np.all(norm > 0.0):
            raise ModelError("a quaternion of length zero is no rotation")
        w, x, y, z = np.moveaxis(q / norm, -1, 0)
        rotation = np.stack(
            [
                np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)], -1),
                np.stack([2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)], -1),
                np.stack([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], -1),
            ],
            -2,
        )
        return cls(rotation, np.array(positions_xyz, float))

    @classmethod
    def from_tangent(cls, tangent: Array, dim: int) -> "Pose":
        """The pose identity (+) tangent: (..., 3) in the plane, (..., 6) in space."""
        return cls(rotations(dim).exp(tangent[..., dim:]), tangent[..., :dim].copy())

    @classmethod
    def scattered(cls, positions: Array, rng: np.random.Generator) -> "Pose":
        """Poses at positions (n, d), turned at random: any way as likely as any other."""
        if positions.shape[-1] == 2:
            turns = rng.uniform(-np.pi, np.pi, (len(positions), 1))
            return cls.from_xytheta(np.concatenate([positions, turns], -1))
        return cls.from_quaternion(positions, rng.standard_normal((len(positions), 4)))

    # --- reading poses ------------------------------------------------------------------------------------------

    @property
    def dim(self) -> int:
        """2 in the plane, 3 in space."""
        return int(self.translation.shape[-1])

    @property
    def dof(self) -> int:
        """3 in the plane, 6 in space."""
        return self.dim + int(rotations(self.dim).DOF)

    @property
    def batch(self) -> tuple[int, ...]:
        """The leading axes."""
        return self.translation.shape[:-1]

    def __len__(self) -> int:
        return len(self.translation)

    def __getitem__(self, index: int | slice | IntArray | list[int] | tuple[slice | int | None, ...] | None) -> "Pose":
        """The poses at an index of the leading axes."""
        return Pose(self.rotation[index], self.translation[index])

    @property
    def heading(self) -> Array:
        """Yaw [rad] about the vertical: the angle of the body's forward axis in the horizontal plane, (...)."""
        return np.asarray(np.arctan2(self.rotation[..., 1, 0], self.rotation[..., 0, 0]))

    def xytheta(self) -> Array:
        """(..., 3): x, y [m], heading [rad]; of a spatial pose, its shadow on the ground."""
        return np.concatenate([self.translation[..., :2], self.heading[..., None]], -1)

    def quaternion_wxyz(self) -> Array:
        """(..., 4): the rotation as a unit quaternion, scalar first and not negative (planar poses: about z)."""
        w = so3.log(self.lift(3).rotation)
        half = 0.5 * np.linalg.norm(w, axis=-1, keepdims=True)
        return np.concatenate([np.cos(half), 0.5 * np.sinc(half / np.pi) * w], -1)

    def numbers(self) -> Array:
        """As people write a pose: x, y, heading (..., 3) in the plane; position, then quaternion (..., 7) in space."""
        return self.xytheta() if self.dim == 2 else np.concatenate([self.translation, self.quaternion_wxyz()], -1)

    # --- the group ----------------------------------------------------------------------------------------------

    def __matmul__(self, other: "Pose") -> "Pose":
        """Composition: (A @ B).act(p) = A.act(B.act(p)). Mixed dimensions are lifted to space."""
        dim = max(self.dim, other.dim)
        a, b = self.lift(dim), other.lift(dim)
        return Pose(a.rotation @ b.rotation, a.act(b.translation))

    def inverse(self) -> "Pose":
        """X^-1, with X @ X^-1 = identity."""
        transposed = np.swapaxes(self.rotation, -1, -2)
        return Pose(transposed, -_apply(transposed, self.translation))

    def between(self, other: "Pose") -> "Pose":
        """X1^-1 X2: the other pose as seen from this one."""
        return self.inverse() @ other

    def act(self, points: Array) -> Array:
        """Body points to the world: R p + T, (..., d) -> (..., d)."""
        return np.asarray(_apply(self.rotation, points) + self.translation)

    def unact(self, points: Array) -> Array:
        """World points to the body: R'(p - T), (..., d) -> (..., d). Law: X.unact(X.act(p)) = p."""
        return _apply(np.swapaxes(self.rotation, -1, -2), points - self.translation)

    def adjoint(self) -> Array:
        """A (..., n, n) with X (I (+) d) X^-1 ~ I (+) A d to first order in d, in the mixed chart at the identity."""
        group, d, n = rotations(self.dim), self.dim, self.dof
        turned = group.adjoint(self.rotation)
        out = np.zeros((*self.batch, n, n))
        out[..., :d, :d] = self.rotation
        out[..., d:, d:] = turned
        # Turning about the body's origin moves the world's origin: the velocity is -(A w) x T.
        basis = np.eye(n - d)
        for k in range(n - d):
            out[..., :d, d + k] = -_apply(group.hat(_apply(turned, basis[k])), self.translation)
        return out

    # --- the chart ----------------------------------------------------------------------------------------------

    def retract(self, delta: Array) -> "Pose":
        """X (+) delta = (R Exp(dw), T + dT), delta (..., 3) or (..., 6) = [dT, dw]."""
        d = self.dim
        return Pose(self.rotation @ rotations(d).exp(delta[..., d:]), self.translation + delta[..., :d])

    def minus(self, other: "Pose") -> Array:
        """self (-) other = [T - To ; Log(Ro' R)], (..., 3) or (..., 6). Law: (X (+) d) (-) X = d for |dw| < pi."""
        turn = rotations(self.dim).log(np.swapaxes(other.rotation, -1, -2) @ self.rotation)
        return np.concatenate([self.translation - other.translation, turn], -1)

    def sharpened(self) -> "Pose":
        """The same poses with the rounding of long products taken out of their rotations: R'R = 1 to working precision.

        One Newton step to the nearest rotation, R (3 - R'R) / 2 (Higham 1986): errors of size e become e^2.
        """
        eye = np.eye(self.dim)
        gram = np.swapaxes(self.rotation, -1, -2) @ self.rotation
        return Pose(self.rotation @ (1.5 * eye - 0.5 * gram), self.translation)

    # --- plane and space ----------------------------------------------------------------------------------------

    def lift(self, dim: int) -> "Pose":
        """The same pose in a space of `dim`: a planar pose becomes one at height 0 that only yaws.

        Raises ModelError for a spatial pose asked to lie in the plane, which would lose height and tilt silently.
        """
        if dim == self.dim:
            return self
        if dim < self.dim:
            raise ModelError("a spatial pose cannot be put into the plane without loss")
        rotation = np.zeros((*self.batch, 3, 3))
        rotation[..., :2, :2] = self.rotation
        rotation[..., 2, 2] = 1.0
        return Pose(rotation, np.concatenate([self.translation, np.zeros((*self.batch, 1))], -1))

    def onto(self, dim: int) -> "Pose":
        """The same pose in a space of `dim`: lifted, or where it has more dimensions than that its shadow on the
        ground."""
        return Pose.from_xytheta(self.xytheta()) if dim < self.dim else self.lift(dim)


def lift_tangent(dim_from: int, dim_to: int) -> Array:
    """E with (X (+) d).lift = X.lift (+) E d: the identity, or the 6 x 3 selection [x, y, yaw]."""
    if dim_from == dim_to:
        return np.eye(3 if dim_from == 2 else 6)
    selection = np.zeros((6, 3))
    selection[0, 0] = selection[1, 1] = selection[5, 2] = 1.0
    return selection


def lift_points(points: Array, dim: int) -> Array:
    """Points (..., d) in a space of `dim`: planar ones lie at height 0. ModelError where height would be lost."""
    if points.shape[-1] > dim:
        raise ModelError("a point in space cannot be put into the plane without loss")
    return np.concatenate([points, np.zeros((*points.shape[:-1], dim - points.shape[-1]))], -1)


def concatenate(poses: list[Pose]) -> Pose:
    """Poses one after another along the first axis."""
    return Pose(np.concatenate([p.rotation for p in poses]), np.concatenate([p.translation for p in poses]))


def compose_along(steps: Pose) -> Pose:
    """The poses (n + 1,) from the identity on along n steps: X_0 = I, X_t = X_{t-1} @ step_t."""
    poses = concatenate([Pose.identity(steps.dim, (1,)), steps])
    reach = 1
    while reach < len(poses):
        poses = concatenate([poses[:reach], poses[:-reach] @ poses[reach:]])
        reach *= 2
    return poses


def _apply(matrix: Array, vector: Array) -> Array:
    return np.asarray((matrix @ np.asarray(vector)[..., None])[..., 0])
