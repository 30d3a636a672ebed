"""Maps made by hand: a truth, an error of known law, and the information that goes with it."""

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from teamslam.geometry import Array, Pose
from teamslam.model import Dataset, Sources, Submap, Values
from teamslam.sim import simulate

TEAMS = ("2d", "planar", "3d", "mixed", "tags")


def at_base(dataset: Dataset) -> tuple[int, Values]:
    """The first pose of robot 1, and the truth written in its frame."""
    base = int(dataset.pose_keys[1][0])
    assert dataset.truth is not None
    return base, dataset.truth.transform(dataset.truth.pose(base).inverse())


def map_of(dataset: Dataset, error: Array | None = None, information: Array | None = None) -> Submap:
    """A map whose truth (-) estimate is `error` (0), in the frame of robot 1's first pose."""
    base, values = at_base(dataset)
    values = values.select(values.layout.keys != base)
    n = values.layout.dof
    submap = Submap(
        id="made",
        version=0,
        base=base,
        base_dim=dataset.robots[1],
        values=values,
        information=sp.csr_array(np.eye(n) if information is None else information),
        sources=Sources(),
        names=dataset.names,
    )
    return submap if error is None else replace(submap, values=_before(values, error))


def _before(values: Values, error: Array) -> Values:
    """The estimate x with values (-) x = error: translations go back by it, rotations by its inverse on the right."""
    estimate = values.retract(-error)
    assert np.allclose(values.minus(estimate), error, atol=1e-9)
    return estimate


def with_truth(dataset: Dataset, truth: Values) -> Dataset:
    """The same log with another truth."""
    return replace(dataset, truth=truth)


def small(team: str, seed: int = 0, **options: object) -> Dataset:
    """A short log of one of the simulator's teams."""
    from teamslam.sim import PRESETS

    return simulate(replace(PRESETS[team], **({"poses": 8, "landmarks": 12} | options)), seed)  # type: ignore[arg-type]


def some_frame(dim: int, rng: np.random.Generator) -> Pose:
    """Anywhere, turned anyhow."""
    turn = rng.uniform(-2.0, 2.0, 1 if dim == 2 else 3)
    return Pose.from_tangent(np.concatenate([rng.normal(0.0, 5.0, dim), turn]), dim)


def frame_dim(dataset: Dataset) -> int:
    """The dimension of a motion that keeps every robot where it can be: on the ground, if any is there."""
    return min(dataset.robots.values())
