"""JSON robot logs: what stands in one, noise against GTSAM's factors, labels of outliers, and every kind of damage."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from scipy.spatial.transform import Rotation

from damage import damaged_text, survives
from strategies import unit_vectors
from teamslam.errors import InputError
from teamslam.geometry import Pose
from teamslam.io import read, write
from teamslam.io.graphs import jrl
from teamslam.io.graphs.jrl_noise import covariance_here, covariance_there, gtsam_basis
from teamslam.io.graphs.symbols import join_symbol
from teamslam.model import MODELS, Dataset, Table, pack, pose_key, whitening

A0, A1, B0, L3 = join_symbol("a", 0), join_symbol("a", 1), join_symbol("b", 0), join_symbol("l", 3)
I3 = [1, 0, 0, 0, 1, 0, 0, 0, 1]
POSE = {"type": "Pose2", "x": 1.0, "y": 0.0, "theta": 0.5}


def factor(kind: str, keys: tuple[int, ...], measured: Any, covariance: list[float]) -> dict[str, Any]:
    names = ("key",) if len(keys) == 1 else ("key1", "key2")
    what = "prior" if len(keys) == 1 else "measurement"
    return {"type": kind, **dict(zip(names, keys, strict=True)), what: measured, "covariance": covariance}


LOG: dict[str, Any] = {
    "name": "team",
    "robots": ["a", "b"],
    "measurements": {
        "a": [
            {"stamp": 0, "measurements": [factor("PriorFactorPose2", (A0,), POSE, I3)]},
            {
                "stamp": 1,
                "measurements": [
                    factor("BetweenFactorPose2", (A0, A1), POSE, I3),
                    factor("RangeFactor2D", (A1, L3), {"type": "Scalar", "value": 2.0}, [0.04]),
                    factor("FancyFactor", (A1,), POSE, I3),
                    factor("BetweenFactorPose2", (A1, B0), POSE, I3),
                ],
            },
        ],
        "b": [
            {
                "stamp": 0,
                "measurements": [
                    factor(
                        "BearingRangeFactor2D",
                        (B0, L3),
                        {"type": "BearingRange", "bearing": {"type": "Rot2", "theta": 0.3}, "range": 1.5},
                        [0.01, 0, 0, 0.09],
                    )
                ],
            }
        ],
    },
    "groundtruth": {"a": [{"key": A0, **POSE}, {"key": L3, "type": "Point2", "x": 1, "y": 2}], "b": []},
    "initialization": {"a": {str(A1): POSE}},
    "outlier_factors": {"a": [[1, 3]]},
}


def written(folder: Path, log: Any) -> Path:
    path = folder / "log.jrl"
    path.write_text(log if isinstance(log, str) else json.dumps(log))
    return path


def test_what_stands_in_a_log(tmp_path: Path) -> None:
    found = read(written(tmp_path, LOG))
    assert found.robots == {1: 2, 2: 2} and found.names.robots == {1: "a", 2: "b"}
    a0, a1, b0 = (int(k) for k in pose_key(np.array([1, 1, 2]), np.array([0, 1, 0])))
    assert [(t.robot, t.source, t.model, t.keys.tolist()) for t in found.tables] == [
        (1, "world", "pose", [[a0]]),
        (1, "odometry", "relative_pose", [[a0, a1]]),
        (1, "landmarks", "range", [[a1, 3]]),
        (1, "robots", "relative_pose", [[a1, b0]]),
        (2, "landmarks", "range_bearing", [[b0, 3]]),
    ]
    sighting = found.tables[-1]
    assert sighting.values.tolist() == [[1.5, 0.3]]  # range first
    assert np.allclose(sighting.whitening[0], np.diag([1 / 0.3, 1 / 0.1]))
    assert found.truth is not None and found.truth.layout.keys.tolist() == [a0, 3]
    assert found.initial is not None and found.initial.layout.keys.tolist() == [a1]
    assert [(d.count, d.reason) for d in found.dropped] == [(1, "factors of the unknown type FancyFactor")]


def test_labelled_outliers_are_left_out_where_asked(tmp_path: Path) -> None:
    found = read(written(tmp_path, LOG), drop_outliers=True)
    assert not any(t.source == "robots" for t in found.tables)
    assert (1, "measurements labelled as outliers") in [(d.count, d.reason) for d in found.dropped]


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("model", ["relative_pose", "pose", "range_bearing"])
def test_noise_means_what_gtsams_factors_mean(model: str, dim: int) -> None:
    """Near the measurement, GTSAM's factor with the file's covariance costs what teamslam's row costs."""
    gtsam = pytest.importorskip("gtsam")
    rng = np.random.default_rng(3)
    rows = MODELS[model].residual_rows(dim)
    for _ in range(10):
        root = rng.normal(size=(rows, rows)) + 2 * np.eye(rows)
        theirs = root @ root.T
        noise = gtsam.noiseModel.Gaussian.Covariance(theirs)
        at = gtsam.Values()
        if model == "range_bearing":
            direction = unit_vectors(rng, dim, ())
            distance = rng.uniform(1.0, 5.0)
            point = (distance + 1e-6 * rng.normal()) * direction + 1e-6 * rng.normal(size=dim)
            at.insert(0, gtsam.Pose2() if dim == 2 else gtsam.Pose3())
            at.insert(1, point)
            angle = np.arctan2(direction[1], direction[0])
            z = np.array([distance, angle]) if dim == 2 else np.array([distance, *direction])
            made = (
                gtsam.BearingRangeFactor2D(0, 1, gtsam.Rot2(angle), distance, noise)
                if dim == 2
                else gtsam.BearingRangeFactor3D(0, 1, gtsam.Unit3(direction), distance, noise)
            )
            h = MODELS[model].predict(Pose.identity(dim, (1,)), point[None], dim)
        else:
            pose = Pose.from_tangent(rng.normal(size=3 if dim == 2 else 6), dim)
            near = pose.retract(1e-6 * rng.normal(size=pose.dof))
            z, h = pack(pose), pack(near)[None]
            made = gtsam.PriorFactorPose2 if dim == 2 else gtsam.PriorFactorPose3
            made = made(0, gtsam_pose(gtsam, pose), noise)
            at.insert(0, gtsam_pose(gtsam, near))
        w = whitening(covariance_here(theirs, z, model, dim))
        e = w @ MODELS[model].minus(z[None], h, dim)[0]
        assert e @ e == pytest.approx(2.0 * made.error(at), rel=1e-4)
        back = covariance_there(covariance_here(theirs, z, model, dim), z, model, dim)
        assert np.allclose(back, theirs, rtol=1e-9)


def gtsam_pose(gtsam: Any, pose: Pose) -> Any:
    if pose.dim == 2:
        return gtsam.Pose2(*pose.xytheta())
    return gtsam.Pose3(gtsam.Rot3(pose.rotation), pose.translation)


def test_the_basis_is_gtsams() -> None:
    gtsam = pytest.importorskip("gtsam")
    for direction in [*unit_vectors(np.random.default_rng(0), 3, (50,)), *np.eye(3), *-np.eye(3)]:
        assert np.allclose(gtsam.Unit3(direction).basis(), gtsam_basis(direction))


def test_poses_of_space_come_with_the_scalar_first(tmp_path: Path) -> None:
    q = Rotation.from_rotvec([0.1, 0.2, 0.3]).as_quat()
    pose = {"type": "Pose3", "translation": [1, 2, 3], "rotation": [q[3], *q[:3]]}
    log = {
        "robots": ["a"],
        "measurements": {
            "a": [
                {"stamp": 0, "measurements": [factor("BetweenFactorPose3", (A0, A1), pose, np.eye(6).ravel().tolist())]}
            ]
        },
    }
    value = read(written(tmp_path, log)).tables[0].values[0]
    assert np.allclose(value[3:].reshape(3, 3), Rotation.from_rotvec([0.1, 0.2, 0.3]).as_matrix())


def damaged(path: str, value: Any) -> dict[str, Any]:
    """LOG with one value replaced; the path goes by keys and indices."""
    log = json.loads(json.dumps(LOG))
    place: Any = log
    *way, last = [int(part) if part.isdigit() else part for part in path.split(".")]
    for part in way:
        place = place[part]
    if value is None:
        del place[last]
    else:
        place[last] = value
    return log


BETWEEN, RANGE = "measurements.a.1.measurements.0", "measurements.a.1.measurements.1"
DAMAGE: dict[str, tuple[Any, str]] = {
    "empty": ("", "no JSON"),
    "cut": (json.dumps(LOG)[:300], "this is no JSON"),
    "nan": (json.dumps(LOG).replace("2.0", "NaN"), "'NaN' stands where a finite number is needed"),
    "a list": ([], "expected an object with 'measurements', found a list"),
    "no measurements": (damaged("measurements", None), "'measurements' is missing"),
    "nothing known": (damaged("measurements", {"a": []}), "no factor that teamslam knows"),
    "no key": (damaged(f"{BETWEEN}.key2", None), r"measurements.a\[1\].measurements\[0\]': 'key2' is missing"),
    "key no number": (damaged(f"{BETWEEN}.key2", "a1"), r"key2': expected a whole number, found 'a1'"),
    "key of no robot": (damaged(f"{BETWEEN}.key2", 5), "the key 5 is no robot's pose"),
    "key too large": (damaged(f"{BETWEEN}.key2", 2**64), "keys run from 0"),
    "to itself": (damaged(f"{BETWEEN}.key2", A0), "to itself"),
    "covariance too short": (damaged(f"{BETWEEN}.covariance", [1, 0]), r"expected 9 numbers .*found 2"),
    "covariance indefinite": (damaged(f"{BETWEEN}.covariance", [-1, *I3[1:]]), "covariance is not positive definite"),
    "covariance lopsided": (damaged(f"{BETWEEN}.covariance", [1, 0.5, *I3[2:]]), "covariance is not symmetric"),
    "infinite": (damaged(f"{BETWEEN}.measurement.x", 1e300), "measurement.x': expected a finite number"),
    "text for a number": (damaged(f"{RANGE}.measurement.value", "far"), "measurement.value': expected a finite number"),
    "negative range": (damaged(f"{RANGE}.measurement.value", -1), "a range is not negative"),
    "type no text": (damaged(f"{RANGE}.type", 3), "type': expected a text, found 3"),
    "damaged note": (damaged("teamslam", {"tick_s": 1}), "field 'teamslam': the note of names is damaged"),
    "strange label": (damaged("outlier_factors.a", [[1, 2, 3]]), "a label is a pair"),
    "plane and space": (
        damaged(f"{RANGE}", factor("RangeFactor3D", (A1, L3), 2.0, [0.04])),
        "robot a has poses in the plane and in space",
    ),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_damage_is_named(name: str, tmp_path: Path) -> None:
    content, expected = DAMAGE[name]
    with pytest.raises(InputError, match=expected) as caught:
        read(written(tmp_path, content))
    assert "log.jrl" in str(caught.value)


def test_what_jrl_cannot_say_is_refused(tmp_path: Path) -> None:
    found = read(written(tmp_path, LOG))
    keys = found.tables[2].keys
    bearing = Table(1, "landmarks", "bearing", 2, keys, np.ones((1, 1)), np.eye(1)[None], np.array([9]))
    with pytest.raises(InputError, match=r"no word for landmarks \(bearing, 2D, POSE2 to POINT2\)"):
        write(found.with_tables([bearing]), tmp_path / "out.jrl")


@given(damaged_text(json.dumps(LOG, indent=1)))
def test_nothing_but_a_log_or_an_error_comes_out(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    found = survives(jrl.read, tmp_path_factory.mktemp("fuzz") / "log.jrl", content)
    assert found is None or isinstance(found, Dataset)
