"""The start part by part, for a log of which other starts make no sense."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from strategies import generators
from teamslam.geometry import Pose
from teamslam.io import read
from teamslam.joining import build, full, join, split
from teamslam.joining.start.driven import driven
from teamslam.joining.start.starts import local_kinds
from teamslam.model import Dataset, Values, pose_kind
from teamslam.sim import Options, simulate
from teamslam.sim.scenario import Robot
from teamslam.sim.sense import Odometry, Sensor

EXACT = Robot(Odometry(1e-9, 1e-9), Sensor("point", sigma_m=1e-9, range_m=8.0), None)


@given(generators, st.sampled_from(["2d", "planar", "3d"]), st.integers(2, 50), st.floats(0.0, 0.3))
def test_without_noise_it_is_the_truth_however_dead_reckoning_drifts(
    rng: np.random.Generator, space: str, poses: int, drift: float
) -> None:
    """All rows say the truth, and the way that it hangs on does not: odometry's rows count, not the way."""
    options = Options(space=space, robots=1, poses=poses, landmarks=20, team=(EXACT,))
    log = simulate(options, int(rng.integers(1 << 30)))
    dim = log.robots[1]
    assert log.truth is not None
    keys = log.truth.layout.keys[log.truth.layout.kinds == pose_kind(dim)]
    way = log.truth.only(keys).transform(log.truth.pose(int(keys[0])).inverse())
    turns = np.zeros((len(keys), 3 * dim - 3))
    turns[1:, -1] = drift * rng.uniform(-1.0, 1.0)
    steps = way.poses_of(keys[:-1], dim).between(way.poses_of(keys[1:], dim))
    drifting = [Pose.identity(dim)]
    for n in range(len(keys) - 1):
        drifting.append(drifting[-1] @ steps[n].retract(turns[n + 1]))
    bent = Values.of({pose_kind(dim): (keys, Pose(*_stacked(drifting)))})
    found = driven(log.tables, bent, local_kinds(log.layout, dim), dim)
    got, wanted = found.poses_of(keys, dim), way.poses_of(keys, dim)
    np.testing.assert_allclose(np.abs(got.minus(wanted)).max(), 0.0, atol=1e-5)


def _stacked(poses: list[Pose]) -> tuple[np.ndarray, np.ndarray]:
    return np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses])


@pytest.fixture(scope="module")
def victoria_park() -> Dataset:
    """The whole log as iSAM has it: 6,969 poses in one chain, few sightings, loops of hundreds of poses."""
    gtsam = pytest.importorskip("gtsam", reason="the log comes with the GTSAM wheel, which is not installed here")
    path = Path(gtsam.__file__).parent / "Data" / "victoria_park.txt"
    if not path.exists():
        pytest.skip(f"this wheel of GTSAM has no {path.name}")
    return read(path)


@pytest.fixture(scope="module")
def whole(victoria_park: Dataset) -> float:
    """What the log costs as one submap."""
    return build(victoria_park).cost


@pytest.mark.slow
def test_a_log_that_dead_reckoning_misleads_fits(victoria_park: Dataset, whole: float) -> None:
    """An optimum from dead reckoning costs 93 times its degrees of freedom; one that makes sense costs one of each or
    less."""
    submap = build(victoria_park)
    dof = submap.rows - submap.dof
    whitened = np.concatenate([t.whitened(submap.all_values).ravel() for t in victoria_park.tables])
    assert float(whitened @ whitened) == pytest.approx(whole, rel=1e-9)
    assert 0.7 * dof < whole < 1.1 * dof


@pytest.mark.parametrize("poses", [50, 200])
def test_so_do_its_pieces(victoria_park: Dataset, whole: float, poses: int) -> None:
    """A chain of many pieces, laid end to end, is dead reckoning again; from the map that it makes, full least squares
    ends where that of the whole log does."""
    joined = join([build(piece) for piece in split(victoria_park, poses_per_piece=poses)])
    assert len(joined.components) == 1 and joined.converged
    assert full(victoria_park, initial=joined).map.cost == pytest.approx(whole, rel=1e-6)
