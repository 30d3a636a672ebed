"""What hypothesis draws for the laws: batch shapes, rotations at every awkward angle, poses, points, values.

Angles are drawn from the places where formulas change (0, the limits of the series, just short of pi) as well as from
everywhere; directions and positions come from a seeded generator, so that an example that fails is small and repeats.
"""

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from teamslam.geometry import Array, Pose, rotations
from teamslam.model import Kind, Values, landmark_key, pose_key

AWKWARD_ANGLES = [0.0, 1e-300, 1e-15, 1e-12, 1e-8, 9.9e-5, 1e-4, 1.01e-4, 1e-3, 9.99e-3, 1.001e-2, 0.1, 1.0, 2.0, 3.0]
NEAR_PI = [np.pi - 1e-2, np.pi - 1e-4, np.pi - 1e-6, np.pi - 1e-9]

dims = st.sampled_from([2, 3])
batches = hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=3)
seeds = st.integers(0, 2**32 - 1)
generators = seeds.map(np.random.default_rng)


@st.composite
def rotation_vectors(draw: st.DrawFn, dim: int, batch: tuple[int, ...], *, near_pi: bool = True) -> Array:
    """Tangents of SO(dim), (..., 1 or 3), shorter than pi."""
    awkward = AWKWARD_ANGLES + (NEAR_PI if near_pi else [])
    angles = draw(hnp.arrays(float, batch, elements=st.one_of(st.sampled_from(awkward), st.floats(0.0, 3.1))))
    directions = unit_vectors(draw(generators), rotations(dim).DOF, batch)
    return directions * angles[..., None]


@st.composite
def poses(draw: st.DrawFn, dim: int, batch: tuple[int, ...], *, near_pi: bool = True) -> Pose:
    """Poses of a batch, within some metres of the origin."""
    w = draw(rotation_vectors(dim, batch, near_pi=near_pi))
    return Pose(rotations(dim).exp(w), draw(generators).normal(scale=5.0, size=(*batch, dim)))


def unit_vectors(rng: np.random.Generator, dim: int, batch: tuple[int, ...]) -> Array:
    """Directions, even over the circle or sphere; signs where dim is 1."""
    v = rng.normal(size=(*batch, dim)) + 1e-9
    return np.asarray(v / np.linalg.norm(v, axis=-1, keepdims=True))


def random_poses(rng: np.random.Generator, dim: int, *batch: int, spread: float = 5.0, turn: float = 2.0) -> Pose:
    """Poses without hypothesis: turned by up to `turn` [rad], placed with a deviation of `spread` [m]."""
    group = rotations(dim)
    w = unit_vectors(rng, group.DOF, batch) * rng.uniform(0.0, turn, (*batch, 1))
    return Pose(group.exp(w), rng.normal(scale=spread, size=(*batch, dim)))


def random_values(rng: np.random.Generator, counts: dict[Kind, int]) -> Values:
    """Values with so many variables of each kind; keys differ between kinds and are in no order."""
    parts: dict[Kind, tuple[Array, Pose | Array]] = {}
    for kind, count in counts.items():
        numbers = rng.permutation(3 * count)[:count] + 1000 * int(kind)
        keys = pose_key(1 + int(kind), numbers) if kind.is_pose else landmark_key(numbers)
        data = random_poses(rng, kind.dim, count) if kind.is_pose else rng.normal(scale=5.0, size=(count, kind.dim))
        parts[kind] = (keys, data)
    return Values.of(parts)


values_of_any_kind = st.builds(
    lambda rng, counts: random_values(rng, dict(zip(Kind, counts, strict=True))),
    generators,
    st.tuples(*[st.integers(0, 4)] * 4),
)
