"""The plain format: what is written comes back, the documentation's example, keyframes, and every kind of damage."""

import re
import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from damage import damaged_bytes, damaged_text
from logs import assert_rows_numbered_once, assert_same_values, measured
from strategies import generators, random_poses
from teamslam.errors import InputError, TeamslamError
from teamslam.geometry import IntArray, Pose
from teamslam.io import plain
from teamslam.model import (
    LOSSES,
    MODELS,
    Dataset,
    Dropped,
    Kind,
    Loss,
    Names,
    Table,
    Values,
    index_of,
    landmark_key,
    landmark_number,
    pose_key,
)
from teamslam.model.sensors import pose_of

DOCUMENTATION = Path(__file__).parents[3] / "docs" / "formats.md"
TEAM = """
[[robot]]
name = "red"
[[log]]
file = "odometry.csv"
model = "relative_pose"
robot = "red"
sigma = [0.1, 0.1, 0.1]
[[log]]
file = "landmarks.csv"
model = "range_bearing"
robot = "red"
sigma = [0.1, 0.02]
"""
ODOMETRY = "from_stamp,to_stamp,x,y,theta\n0,1,1,0,0.5\n1,2,1,0,0.5\n"
LANDMARKS = "stamp,landmark,range,bearing\n0,7,2,0.5\n2,8,3,0.1\n"


def folder(path: Path, **files: str) -> Path:
    """A folder with the small team above, some of its files replaced by others (names without endings)."""
    path.mkdir(exist_ok=True)
    for name, text in {"team": TEAM, "odometry": ODOMETRY, "landmarks": LANDMARKS, **files}.items():
        (path / ("team.toml" if name == "team" else f"{name}.csv")).write_text(text, encoding="utf-8")
    return path


def documented_example(path: Path) -> Path:
    """The files of the documentation's example."""
    text = DOCUMENTATION.read_text(encoding="utf-8")
    text = text[text.index("### An example to copy") : text.index("### Models")]
    names = re.findall(r"`(\w+\.(?:toml|csv))`(?=:| and |\n\n)", text)
    blocks = re.findall(r"```\w+\n(.*?)```", text, re.DOTALL)
    names = list(dict.fromkeys([*names, "truth_landmarks.csv"]))
    for name, block in zip(names, blocks, strict=True):
        (path / name).write_text(block, encoding="utf-8")
    return path


# --- what is written comes back -----------------------------------------------------------------------------------


@st.composite
def any_log(draw: st.DrawFn) -> Dataset:
    """A log of any models, dimensions, sensors, losses and noise, of robots of any kinds."""
    rng = draw(generators)
    robots = {
        int(n): int(rng.choice([2, 3])) for n in rng.choice(np.arange(1, 4096), rng.integers(1, 4), replace=False)
    }
    tick_s = draw(st.sampled_from([1e-6, 1.0, 0.001]))
    poses = np.concatenate([pose_key(r, rng.integers(0, 10**12, 4)) for r in robots])
    marks = landmark_key(np.array([3, 7, 1 << 50, landmark_number("front door")]))
    names = Names({min(robots): "Ada, the first"}, {3: "tag;3", int(marks[3]): "front door", 99: "unseen"}, tick_s)
    tables, taken = [], dict[tuple[int, str], int]()
    for _ in range(draw(st.integers(0, 5))):
        table = _any_table(rng, robots, poses, marks)
        first = taken.get((table.robot, table.source), 0)
        taken[table.robot, table.source] = first + 10
        tables.append(_with_ids(table, first + rng.permutation(10)[: len(table)]))
    parts = {
        Kind.POSE2: (poses[:3], random_poses(rng, 2, 3)),
        Kind.POINT3: (marks[:2], rng.normal(size=(2, 3))),
        Kind.POSE3: (np.array([poses[3], marks[2]]), random_poses(rng, 3, 2)),
    }
    # A file has each robot's poses in the dimension that the robot moves in.
    kinds = {Kind.POSE2: 2, Kind.POSE3: 3}
    values = Values.of(parts)
    keep = [
        not (k >= 1 << 51 and robots[k >> 51] != kinds[Kind(kind)])
        for k, kind in zip(values.layout.keys.tolist(), values.layout.kinds.tolist(), strict=True)
    ]
    some = values.select(np.array(keep))
    dropped = (Dropped(3, 'rows with "quotes"'),) if draw(st.booleans()) else ()
    truth, initial = (some if draw(st.booleans()) else None for _ in range(2))
    return Dataset(robots, tuple(tables), names, truth, initial, dropped)


def _any_table(rng: np.random.Generator, robots: dict[int, int], poses: IntArray, marks: IntArray) -> Table:
    dim, count = int(rng.choice([2, 3])), int(rng.integers(0, 4))
    model = str(rng.choice([name for name, row in MODELS.items() if row.z_size(dim)]))
    robot = int(rng.choice(list(robots)))
    target = rng.choice(poses if rng.random() < 0.5 else marks, count)
    own = poses[poses >> 51 == robot]
    observer = rng.choice(own if rng.random() < 0.8 else poses, count)
    observer = np.where(observer == target, own[0] + 1, observer)
    keys = target[:, None] if MODELS[model].unary else np.stack([observer, target], -1)
    rows = MODELS[model].residual_rows(dim)
    whitening = rng.normal(size=(1 if rng.random() < 0.3 else count, rows, rows)) + 4.0 * np.eye(rows)
    mounted = rng.random() < 0.3 and not (MODELS[model].unary and (keys < 1 << 51).any())
    sensor = random_poses(rng, int(rng.integers(2, dim + 1))) if mounted else None
    loss = Loss(str(rng.choice(list(LOSSES))), 2.5) if rng.random() < 0.5 else Loss()
    source = str(rng.choice(["odometry", "landmarks", "robots", "a b/ü"]))
    values = measured(rng, model, dim, count)
    return Table(robot, source, model, dim, keys, values, whitening, np.arange(count), sensor, loss)


def _with_ids(table: Table, ids: IntArray) -> Table:
    return Table(**{**{f: getattr(table, f) for f in table.__dataclass_fields__}, "ids": ids})


@given(any_log())
def test_what_is_written_reads_back_the_same(log: Dataset) -> None:
    with TemporaryDirectory() as path:
        assert plain.write(log, Path(path) / "log") == ()
        found = plain.read(Path(path) / "log")
    assert (found.robots, found.dropped) == (log.robots, log.dropped)
    assert found.names.robots == {n: name for n, name in log.names.robots.items()}
    assert found.names.landmarks == log.names.landmarks and found.names.tick_s == log.names.tick_s
    assert len(found.tables) == len(log.tables)
    for mine, theirs in zip(found.tables, log.tables, strict=True):
        for name in ("robot", "source", "model", "dim", "loss"):
            assert getattr(mine, name) == getattr(theirs, name)
        assert np.array_equal(mine.keys, theirs.keys) and np.array_equal(mine.ids, theirs.ids)
        assert mine.whitening.shape == theirs.whitening.shape
        assert np.allclose(mine.values, theirs.values, atol=1e-12)
        information, expected = (np.swapaxes(w, 1, 2) @ w for w in (mine.whitening, theirs.whitening))
        assert np.abs(information - expected).max(initial=0.0) <= 1e-6 * np.abs(expected).max(initial=1.0)
        assert (mine.sensor is None) == (theirs.sensor is None)
        if mine.sensor is not None and theirs.sensor is not None:
            assert mine.sensor.dim == theirs.sensor.dim and np.abs(mine.sensor.minus(theirs.sensor)).max() < 1e-12
    assert_same_values(found.truth, log.truth if log.truth is None or len(log.truth) else None)
    assert_same_values(found.initial, log.initial if log.initial is None or len(log.initial) else None)


def test_a_table_of_landmarks_and_robots_comes_back_as_two(tmp_path: Path) -> None:
    keys = np.stack([pose_key(1, np.zeros(3, int)), np.array([5, int(pose_key(2, 0)), 6])], -1)
    mixed = Table(1, "tags", "range", 2, keys, np.ones((3, 1)), np.ones((1, 1, 1)), np.arange(3))
    plain.write(Dataset({1: 2, 2: 2}, (mixed,)), tmp_path)
    found = plain.read(tmp_path)
    assert [t.keys[:, 1].tolist() for t in found.tables] == [[5, 6], [int(pose_key(2, 0))]]
    assert_rows_numbered_once(found)


def test_real_data_come_back(tmp_path: Path, data: Callable[[str], Path]) -> None:
    from teamslam.io.logs import mrclam

    log = mrclam.read(data("mrclam_6"))
    plain.write(log, tmp_path)
    found = plain.read(tmp_path)
    assert found.dropped == log.dropped
    for mine, theirs in zip(found.tables, log.tables, strict=True):
        assert np.array_equal(mine.keys, theirs.keys) and np.array_equal(mine.ids, theirs.ids)
        assert np.allclose(mine.values, theirs.values, atol=1e-14) and np.allclose(mine.whitening, theirs.whitening)
    assert_same_values(found.truth, log.truth)


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (Names({1: "twin", 2: "twin"}), "two robots are called 'twin'"),
        (Names({}, {5: "x", 6: "x"}), "two landmarks are called 'x'"),
        (Names({1: " red"}), "cannot be a name"),
        (Names({}, {5: "#5"}), "cannot be a name"),
    ],
)
def test_names_that_cannot_be_written(tmp_path: Path, names: Names, message: str) -> None:
    with pytest.raises(InputError, match=message):
        plain.write(Dataset({1: 2, 2: 2}, (), names), tmp_path)


def test_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        plain.write(Dataset({1: 2}, ()), tmp_path / "file" / "folder")


# --- what users write ---------------------------------------------------------------------------------------------


def test_the_documented_example(tmp_path: Path) -> None:
    found = plain.read(documented_example(tmp_path))
    assert found.names.robots == {1: "red", 2: "blue"} and found.dropped == ()
    assert {found.names.landmark(int(k)) for k in found.landmark_keys} == {"door", "tag 7"}
    assert {(t.robot, t.source): len(t) for t in found.tables} == {
        (1, "odometry"): 4,  # three rows, one of them cut at 2.5 s
        (2, "odometry"): 6,  # two rows cut at 0.5, 1.0 (seen), 2.0 and 2.5 s
        (1, "landmarks"): 5,
        (2, "landmarks"): 4,
        (1, "robots"): 1,
        (2, "robots"): 1,
    }
    assert found.truth is not None and len(found.truth) == 5 + 7 + 2
    # The example is honest: truth explains what was seen within its stated noise.
    sightings = [t for t in found.tables if t.source != "odometry"]
    assert all((np.abs(t.whitened(found.truth)) < 3.5).all() for t in sightings)


def test_increments_are_cut_where_something_was_seen(tmp_path: Path) -> None:
    sightings = "stamp,landmark,range,bearing\n0.25,7,2,0.5\n1.6,8,3,0.1\n0.25,8,2,0.4\n"
    found = plain.read(folder(tmp_path, landmarks=sightings))
    odometry = found.tables[0]
    assert index_of(odometry.keys).tolist() == [
        [0, 250_000], [250_000, 1_000_000], [1_000_000, 1_600_000], [1_600_000, 2_000_000]
    ]  # fmt: skip
    step, parts = Pose.from_xytheta(np.array([1.0, 0.0, 0.5])), pose_of(odometry.values, 2)
    for first in (0, 2):
        assert np.allclose((parts[first] @ parts[first + 1]).minus(step), 0.0, atol=1e-12)
    variances = 1.0 / odometry.whitening[:, 0, 0] ** 2
    assert np.allclose(variances, [0.0025, 0.0075, 0.006, 0.004])
    assert_rows_numbered_once(found)


def test_stamps_that_are_near_enough_are_one(tmp_path: Path) -> None:
    sightings = "stamp,landmark,range,bearing\n0.9995,7,2,0.5\n1.5,7,2,0.5\n1.5008,8,3,0.1\n"
    found = plain.read(folder(tmp_path, landmarks=sightings))
    assert index_of(found.pose_keys[1]).tolist() == [0, 1_000_000, 1_500_000, 2_000_000]


def test_a_sighting_without_odometry_is_left_out_and_counted(tmp_path: Path) -> None:
    odometry = "from_stamp,to_stamp,x,y,theta\n0,1,1,0,0.5\n3,4,1,0,0.5\n"
    sightings = "stamp,landmark,range,bearing\n0.5,7,2,0.5\n2,7,2,0.5\n4.5,8,3,0.1\n"
    found = plain.read(folder(tmp_path, odometry=odometry, landmarks=sightings))
    assert found.dropped == (Dropped(2, "robot red: landmarks where a robot has no odometry"),)
    assert len(found.tables[1]) == 1 and len(found.tables[0]) == 3


@pytest.mark.parametrize(
    ("times", "since", "said"),
    [
        (1e3, 0.0, "their stamps look like milliseconds"),
        (1e6, 0.0, "their stamps look like microseconds"),
        (1.0, 3600.0, "3600.500 to 3604.500 s, the odometry 0.000 to 5.000 s: do both clocks count from one zero?"),
    ],
)
def test_sightings_by_another_clock_than_the_odometry_are_told_what_it_looks_like(
    tmp_path: Path, times: float, since: float, said: str
) -> None:
    odometry = "from_stamp,to_stamp,x,y,theta\n" + "".join(f"{n},{n + 1},1,0,0.5\n" for n in range(5))
    rows = [f"{since + times * (n + 0.5)},7,2,0.5" for n in range(5)]
    found = plain.read(
        folder(tmp_path, odometry=odometry, landmarks="\n".join(["stamp,landmark,range,bearing", *rows]))
    )
    assert any(said in dropped.reason for dropped in found.dropped)


def test_a_clock_that_was_set_back_an_hour_is_told(tmp_path: Path) -> None:
    odometry = "from_stamp,to_stamp,x,y,theta\n7200,7201,1,0,0.5\n7201,3602,1,0,0.5\n3602,3603,1,0,0.5\n"
    with pytest.raises(InputError, match="back by 3599 s, about an hour: a clock that was set back"):
        plain.read(folder(tmp_path, odometry=odometry))


def test_a_robot_that_is_seen_gets_a_pose(tmp_path: Path) -> None:
    team = TEAM.replace('[[robot]]\nname = "red"', '[[robot]]\nname = "red"\n[[robot]]\nname = "blue"')
    team = team.replace('robot = "red"\nsigma = [0.1, 0.1', "sigma = [0.1, 0.1").replace("landmarks.csv", "robots.csv")
    odometry = "robot,from_stamp,to_stamp,x,y,theta\nred,0,2,1,0,0\nblue,0,2,1,0,0\n"
    found = plain.read(
        folder(tmp_path, team=team, odometry=odometry, robots="stamp,other,range,bearing\n0.5,blue,2,1\n")
    )
    assert [index_of(keys).tolist() for keys in found.pose_keys.values()] == [[0, 500_000, 2_000_000]] * 2
    assert found.tables[-1].keys.tolist() == [[int(pose_key(1, 500_000)), int(pose_key(2, 500_000))]]


@pytest.mark.parametrize("dim", [2, 3])
def test_odometry_poses_are_differenced(tmp_path: Path, dim: int) -> None:
    rng, stamps = np.random.default_rng(5), np.arange(0.0, 4.1, 0.5)
    poses = random_poses(rng, dim, len(stamps), turn=0.5)
    columns = "x,y,theta" if dim == 2 else "x,y,z,qw,qx,qy,qz"
    numbers = poses.xytheta() if dim == 2 else np.concatenate([poses.translation, poses.quaternion_wxyz()], -1)
    rows = "\n".join(",".join(map(repr, [t, *row])) for t, row in zip(stamps.tolist(), numbers.tolist(), strict=True))
    team = TEAM.replace('"relative_pose"', '"odometry_poses"\nevery_s = 10').replace(
        "sigma = [0.1, 0.1, 0.1]", f"sigma = {[0.1] * (3 if dim == 2 else 6)}"
    )
    team = team.replace('name = "red"', f'name = "red"\ndim = {dim}').replace("range_bearing", "range")
    found = plain.read(
        folder(tmp_path, team=team.replace("[0.1, 0.02]", "[0.1]"), odometry=f"stamp,{columns}\n{rows}\n",
               landmarks="stamp,landmark,range\n0,7,2\n1,7,2\n3.5,8,3\n")
    )  # fmt: skip
    steps = found.tables[-1]
    assert (index_of(steps.keys) / 1e6).tolist() == [[0.0, 1.0], [1.0, 3.5], [3.5, 4.0]]
    at = np.array([0, 2, 7, 8])
    expected = poses[at[:-1]].between(poses[at[1:]])
    assert np.abs(pose_of(steps.values, dim).minus(expected)).max() < 1e-9
    assert np.allclose(1.0 / steps.whitening[:, 0, 0] ** 2, 0.01 * np.array([1.0, 2.5, 0.5]))


def test_velocities_are_integrated_with_keyframes_often_enough(tmp_path: Path) -> None:
    team = TEAM.replace('"relative_pose"', '"velocity"').replace(
        "sigma = [0.1, 0.1, 0.1]", "every_s = 0.5\nnoise = { forward = 0.1, sideways = 0.01, turn = 0.1 }"
    )
    found = plain.read(folder(tmp_path, team=team, odometry="stamp,v,w\n0,1,0\n1,2,0\n1,1,0\n2,1,0.5\n3,0,0\n"))
    steps = found.tables[-1]
    assert (index_of(steps.keys[:, 1]) / 1e6).tolist() == [0.5, 1.0, 1.5, 2.0, 2.5, 3.0]
    assert np.allclose(steps.values[:4, :2], [[0.5, 0.0]] * 4)
    assert np.allclose(1.0 / steps.whitening[0, 0, 0] ** 2, 0.01 * 0.5)


def test_truth_is_interpolated_to_the_poses(tmp_path: Path) -> None:
    team = TEAM + '[truth]\nrobots = "truth.csv"\nlandmarks = "marks.csv"\n'
    truth = "robot,stamp,x,y,theta\nred,0,0,0,3\nred,0.8,0.8,0,-3\nred,2,2,4,0\n"
    found = plain.read(
        folder(tmp_path, team=team, truth=truth, marks="landmark,x,y,z\n7,1,2,3\n99,0,0,0\n",
               landmarks="stamp,landmark,range,bearing\n0.4,7,2,0.5\n")
    )  # fmt: skip
    assert found.truth is not None
    assert np.allclose(found.truth.pose(int(pose_key(1, 400_000))).translation, [0.4, 0.0])
    assert np.isclose(abs(found.truth.pose(int(pose_key(1, 400_000))).heading), np.pi)
    assert int(pose_key(1, 1_000_000)) not in found.truth.layout.keys  # 1.2 s between samples
    assert found.truth.positions(np.array([7]), 2).tolist() == [[1.0, 2.0]]  # height is not asked for in the plane
    assert 99 not in found.truth.layout.keys  # nor a landmark that nobody saw


def test_a_sensor_by_name_is_each_robot_s_own(tmp_path: Path) -> None:
    team = """
[[robot]]
name = "red"
sensors = { camera = { x = 0.1, theta = 0.5 } }
[[robot]]
name = "blue"
sensors = { camera = { z = 1.0 } }
[[log]]
file = "landmarks.csv"
model = "point"
sensor = "camera"
sigma = [0.1, 0.1, 0.1]
"""
    found = plain.read(
        folder(tmp_path, team=team, landmarks="robot,stamp,landmark,x,y,z\nblue,0,7,1,1,1\nred,0,7,1,1,1\n")
    )
    red, blue = (t.sensor for t in found.tables)
    assert red is not None and blue is not None
    assert np.allclose(red.xytheta(), [0.1, 0.0, 0.5]) and np.allclose(blue.translation, [0.0, 0.0, 1.0])
    assert found.tables[0].dim == 3 and found.dim == 3 and found.is_planar


def test_a_level_sensor_measures_in_the_plane_whatever_its_height(tmp_path: Path) -> None:
    found = plain.read(folder(tmp_path, team=TEAM + "sensor = { x = 0.1, z = 0.5, theta = 0.2 }\n"))
    sensor = found.tables[1].sensor
    assert sensor is not None
    assert sensor.dim == 2
    assert np.allclose(sensor.xytheta(), [0.1, 0.0, 0.2])


def test_spreadsheets_write_semicolons_quotes_and_a_mark_at_the_start(tmp_path: Path) -> None:
    text = '\ufeffstamp;landmark;range;bearing\r\n# a note\r\n\r\n0;"the; door";2;0.5\r\n2; 8 ;3;0.1\r\n'
    found = plain.read(folder(tmp_path, landmarks=text))
    assert {found.names.landmark(int(k)) for k in found.landmark_keys} == {"the; door", "8"}


def test_noise_by_row_beats_noise_for_all(tmp_path: Path) -> None:
    text = "stamp,landmark,range,bearing,sigma_range,sigma_bearing\n0,7,2,0.5,0.5,0.25\n2,8,3,0.1,0.25,0.125\n"
    found = plain.read(folder(tmp_path, landmarks=text))
    assert np.allclose(found.tables[1].whitening, [np.diag([2, 4]), np.diag([4, 8])])
    text = "stamp,landmark,range,bearing,cov_range_range,cov_range_bearing,cov_bearing_bearing\n0,7,2,0.5,2,1,2\n"
    found = plain.read(folder(tmp_path, landmarks=text))
    assert np.allclose(found.tables[1].whitening[0].T @ found.tables[1].whitening[0], np.array([[2, -1], [-1, 2]]) / 3)


def test_repeated_rows_are_left_out_and_counted(tmp_path: Path) -> None:
    found = plain.read(
        folder(tmp_path, landmarks=LANDMARKS + "0,7,2,0.5\n0,7,2,0.6\n", odometry=ODOMETRY + "1,2,1,0,0.5\n")
    )
    assert [d.count for d in found.dropped] == [2] and "repeat" in found.dropped[0].reason
    assert [len(t) for t in found.tables] == [2, 3]


def test_who_surveyed_a_landmark_need_not_be_said(tmp_path: Path) -> None:
    """It is measured from no robot."""
    team = TEAM + '[[log]]\nfile = "plan.csv"\nmodel = "position"\nsigma = [0.01, 0.01]\n'
    found = plain.read(folder(tmp_path, team=team, plan="landmark,x,y\n7,1,2\n"))
    (plan,) = [t for t in found.tables if t.source == "fixes"]
    assert plan.values.tolist() == [[1.0, 2.0]] and plan.robot in found.robots


# --- damage -------------------------------------------------------------------------------------------------------

DAMAGE: dict[str, tuple[dict[str, str], str]] = {
    # what is damaged: (files by name, what the error says)
    "no odometry file": ({"team": TEAM.replace("odometry.csv", "odo.csv")}, r"odo\.csv: no such file"),
    "a missing column": ({"odometry": "from_stamp,to_stamp,x,y\n0,1,1,0\n"}, r"line 1: a relative_pose needs.*theta"),
    "a wrong column": ({"landmarks": LANDMARKS.replace("stamp,", "stamps,")}, r"line 1, field 'stamps'.*'stamp'"),
    "two columns of one name": ({"landmarks": LANDMARKS.replace("range", "stamp")}, "twice in the header"),
    "NaN": ({"landmarks": LANDMARKS + "2,9,nan,0\n"}, r"landmarks\.csv, line 4, field 'range': 'nan' is not a finite"),
    "a word": ({"odometry": ODOMETRY + "2,3,one,0,0\n"}, r"line 4, field 'x': expected a number, found 'one'"),
    "a decimal comma": ({"odometry": ODOMETRY + '2,3,"1,5",0,0\n'}, "write a point"),
    "an empty cell": ({"landmarks": LANDMARKS + "2,7,,0\n"}, r"line 4, field 'range': expected a number, found ''"),
    "an empty robot": ({"odometry": "robot," + ODOMETRY.replace("\n0", "\n,0").replace("\n1", "\nred,1")},
                       r"line 2, field 'robot': empty"),
    "an unknown robot": ({"odometry": "robot," + ODOMETRY.replace("\n0", "\nrde,0").replace("\n1", "\nred,1")},
                         r"line 2, field 'robot': unknown robot 'rde'; did you mean 'red'"),
    "time going back": ({"odometry": ODOMETRY + "4,3,1,0,0\n"}, r"line 4, field 'to_stamp': to_stamp is not after"),
    "overlapping increments": ({"odometry": ODOMETRY + "1.5,3,1,0,0\n"}, r"line 4.*overlaps the increment on line 3"),
    "a recorder that was started again": ({"odometry": ODOMETRY + "0,1,1.1,0,0\n1,2,0.9,0,0\n"},
                                          r"line 4, field 'from_stamp': .*begin anew after line 3.*count on"),
    "a time before 0": ({"landmarks": LANDMARKS + "-1,7,1,0\n"}, r"line 4, field 'stamp': expected a time from 0"),
    "milliseconds": ({"landmarks": LANDMARKS + "1.7e12,7,1,0\n"}, r"line 4, field 'stamp'.*milliseconds"),
    "an empty file": ({"landmarks": ""}, r"landmarks\.csv, line 1: empty; expected a header"),
    "a truncated line": ({"landmarks": LANDMARKS + "2,7,1"}, r"line 4: expected 4 columns .*, found 3"),
    "an open quote": ({"landmarks": LANDMARKS + '2,"7,1,1\n'}, "line 4: not a CSV file"),
    "no noise": ({"team": TEAM.replace("sigma = [0.1, 0.02]\n", "")}, r"no noise is given.*sigma_range, sigma_bearing"),
    "half the noise": ({"landmarks": "stamp,landmark,range,bearing,sigma_range\n0,7,2,0.5,1\n"},
                       "field 'sigma_bearing': there is 'sigma_range' but no such column"),
    "too few sigmas": ({"team": TEAM.replace("[0.1, 0.02]", "[0.1]")}, r"expected 2 numbers \(range, bearing\)"),
    "a sigma of 0": ({"team": TEAM.replace("0.02", "0.0")}, "standard deviations are above 0"),
    "a sigma of 0 in a row": (
        {"landmarks": "stamp,landmark,range,bearing,sigma_range,sigma_bearing\n0,7,2,0.5,1,0\n"},
        r"line 2, field 'sigma_bearing': standard deviations are above 0"),
    "an asymmetric covariance": (
        {"team": TEAM.replace("sigma = [0.1, 0.02]", "covariance = [[1, 0.5], [0, 1]]")}, "not symmetric"),
    "an indefinite covariance": (
        {"team": TEAM.replace("sigma = [0.1, 0.02]", "covariance = [[1, 2], [2, 1]]")}, "not positive definite"),
    "a ragged covariance": (
        {"team": TEAM.replace("sigma = [0.1, 0.02]", "covariance = [[1, 2], [2]]")}, "expected 2 rows of 2 numbers"),
    "an indefinite covariance in a row": (
        {"landmarks": "stamp,landmark,range,bearing,cov_range_range,cov_range_bearing,cov_bearing_bearing\n"
                      "0,7,2,0.5,1,0,1\n0,8,2,0.5,1,2,1\n"}, r"line 3: the covariance is not positive definite"),
    "no target": ({"landmarks": "stamp,range,bearing\n0,2,1\n"}, "needs to say of what: a column 'landmark'"),
    "two targets": ({"landmarks": "stamp,landmark,other,range,bearing\n0,2,red,1,1\n"}, "split it into two files"),
    "a robot that sees itself": ({"landmarks": "stamp,other,range,bearing\n0,red,1,1\n"}, "line 2: a pose cannot be"),
    "nobody speaks": (
        {"team": TEAM.replace('robot = "red"\n', "")}, r"field 'robot': no such column; add it, or write"),
    "not TOML": ({"team": TEAM + "[[log\n"}, r"team\.toml: not valid TOML.*line"),
    "a wrong type": ({"team": TEAM.replace("[0.1, 0.02]", '"large"')}, r"field 'log\[1\]\.sigma': expected"),
    "an unknown key": ({"team": TEAM.replace("sigma", "sgima")}, r"unknown key 'sgima'; did you mean 'sigma'"),
    "a missing key": ({"team": TEAM.replace('model = "range_bearing"\n', "")}, "the key 'model' is missing"),
    "an unknown model": ({"team": TEAM.replace("range_bearing", "range_baering")}, "did you mean 'range_bearing'"),
    "an unknown loss": ({"team": TEAM + 'loss = "hubert"\n'}, "did you mean 'huber'"),
    "no robots": ({"team": "robot = []\n"}, r"at least one \[\[robot\]\]"),
    "two robots of one name": ({"team": '[[robot]]\nname = "red"\n' + TEAM}, "two robots have the name 'red'"),
    "two robots of one number": ({"team": '[[robot]]\nname = "blue"\nnumber = 2\n' + TEAM}, "have the number '2'"),
    "no logs": ({"team": '[[robot]]\nname = "red"\n'}, r"nothing to read: expected a \[\[log\]\]"),
    "an unknown sensor": ({"team": TEAM + 'sensor = "camera"\n'}, "robot red has no sensor 'camera'; it has none"),
    "a tilted sensor in the plane": (
        {"team": TEAM + "sensor = { qw = 0.8, qx = 0.6 }\n"}, "a tilted sensor does not measure in the plane"),
    "a sensor on a landmark": (
        {"team": TEAM.replace("range_bearing", "position") + "sensor = { x = 1.0 }\n",
         "landmarks": "landmark,x,y\n7,1,2\n"}, "landmarks carry no sensor"),
    "a strange sensor": ({"team": TEAM + "sensor = { yaw = 1.0 }\n"}, "unknown key 'yaw'"),
    "one number for two landmarks": (
        {"team": TEAM + "[landmarks]\ndoor = 7\n"}, "'door' and '7' both have the number 7"),
    "truth given twice": (
        {"team": TEAM + '[truth]\nlandmarks = "marks.csv"\n', "marks": "landmark,x,y\n7,1,2\n7,1,3\n"},
        "line 3.*already"),
    "flat truth for a landmark in space": (
        {"team": TEAM.replace('"range_bearing"', '"range"\ndim = 3').replace("[0.1, 0.02]", "[0.1]")
                 + '[truth]\nlandmarks = "marks.csv"\n',
         "landmarks": "stamp,landmark,range\n0,7,1\n", "marks": "landmark,x,y\n7,1,2\n"}, "needs them too"),
    "a robot of another dimension": (
        {"team": TEAM.replace('name = "red"', 'name = "red"\ndim = 3')}, "of dimension 2, but robot red has dim = 3"),
    "a bent quaternion": (
        {"team": TEAM.replace("0.1, 0.1, 0.1", "1, 1, 1, 1, 1, 1").replace('name = "red"', 'name = "red"\ndim = 3'),
         "odometry": "from_stamp,to_stamp,x,y,z,qw,qx,qy,qz\n0,1,1,0,0,1,0,1,0\n"}, "line 2, field 'qw'.*length 1"),
    "an id twice": (
        {"landmarks": "stamp,landmark,range,bearing,id\n0,7,2,0.5,4\n2,8,3,0.1,4\n"},
        "line 3, field 'id'.*stands twice"),
}  # fmt: skip


@pytest.mark.parametrize("damage", DAMAGE)
def test_damage_is_named_with_its_place(tmp_path: Path, damage: str) -> None:
    files, message = DAMAGE[damage]
    with pytest.raises(InputError, match=f"(?s){message}"):
        plain.read(folder(tmp_path, **files))


def with_column(text: str, name: str, cells: list[str], *, first: bool = False) -> str:
    """A CSV text with one column more."""
    pairs = zip(text.splitlines(), [name, *cells], strict=True)
    return "".join(f"{cell},{line}\n" if first else f"{line},{cell}\n" for line, cell in pairs)


@pytest.mark.parametrize("name", ["", "Unnamed: 0"])
@pytest.mark.parametrize("cells", [["0", "1"], ["a", "b"], ['"0"', '"1"']])
def test_the_index_that_pandas_writes_is_not_read(tmp_path: Path, name: str, cells: list[str]) -> None:
    """The log is the same, and nothing is said."""
    marks = "landmark,x,y\n7,1,2\n8,3,4\n"
    team = TEAM + '[truth]\nlandmarks = "marks.csv"\n'
    bare = plain.read(folder(tmp_path / "bare", team=team, marks=marks))
    texts = {"odometry": ODOMETRY, "landmarks": LANDMARKS, "marks": marks}
    indexed = {file: with_column(text, name, cells, first=True) for file, text in texts.items()}
    found = plain.read(folder(tmp_path / "indexed", team=team, **indexed))
    assert found.notes == bare.notes == ()
    assert found.truth is not None and len(found.truth) == 2
    for mine, theirs in zip(found.tables, bare.tables, strict=True):
        np.testing.assert_array_equal(mine.keys, theirs.keys)
        np.testing.assert_array_equal(mine.values, theirs.values)


def test_columns_that_mean_nothing_here_are_named_and_not_read(tmp_path: Path) -> None:
    """Once a file, whatever is in their cells."""
    rows = with_column(with_column(LANDMARKS, "battery_V", ["11.9", "11.8"]), "rssi", ["weak", ""])
    found = plain.read(folder(tmp_path / "more", landmarks=rows))
    bare = plain.read(folder(tmp_path / "bare"))
    assert [note.split(": ", 1)[1] for note in found.notes] == [
        "the columns 'battery_V', 'rssi' have no meaning here and are not read"
    ]
    for mine, theirs in zip(found.tables, bare.tables, strict=True):
        np.testing.assert_array_equal(mine.keys, theirs.keys)
        np.testing.assert_array_equal(mine.values, theirs.values)


@pytest.mark.parametrize(
    "name", ["sigma_bering", "Sigma_range", "sigma_r", "cov_xx", "inf_q", "observr", "othr", "landmark_id", "ids"]
)
def test_a_misspelt_column_is_not_lost(tmp_path: Path, name: str) -> None:
    """What looks like a column that is known, or like noise, is an error; what is known and there is nobody's typo."""
    rows = with_column(LANDMARKS, name, ["1", "2"])
    if name == "landmark_id":
        assert len(plain.read(folder(tmp_path, landmarks=rows)).notes) == 1
        return
    with pytest.raises(InputError, match=f"line 1, field '{name}': unknown column; (did you mean|known columns)"):
        plain.read(folder(tmp_path, landmarks=rows))


def test_a_number_that_is_written_as_a_float_is_the_same_landmark(tmp_path: Path) -> None:
    """And the same robot: pandas writes integers so where one cell of their column is empty."""
    team = TEAM.replace('name = "red"', 'name = "1"').replace('robot = "red"\n', "")
    odometry, more = with_column(ODOMETRY, "robot", ["1.0", "1.0"]), "2,,3,0.1,1\n"
    floats = with_column(LANDMARKS.replace("0,7,", "0,7.0,"), "robot", ["1", "1.0"]) + more
    whole = with_column(LANDMARKS, "robot", ["1", "1"]) + more
    found = plain.read(folder(tmp_path / "floats", team=team, odometry=odometry, landmarks=floats))
    known = plain.read(folder(tmp_path / "whole", team=team, odometry=odometry, landmarks=whole))
    for mine, theirs in zip(found.tables, known.tables, strict=True):
        np.testing.assert_array_equal(mine.keys, theirs.keys)
    assert found.names == known.names
    assert found.names.landmark(7) == "7"


def test_binary_rubbish_and_missing_folders(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such folder"):
        plain.read(tmp_path / "nothing")
    with pytest.raises(InputError, match=r"team\.toml: no such file"):
        plain.read(tmp_path)
    for name in ("team.toml", "landmarks.csv"):
        path = folder(tmp_path / name)
        (path / name).write_bytes(bytes(range(256)))
        with pytest.raises(InputError, match=f"{re.escape(name)}: .*expected a text file"):
            plain.read(path)


def test_options_stand_in_the_folder(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="the plain reader has no option 'sigma'"):
        plain.read(folder(tmp_path), {"sigma": 1.0})


def test_only_folders_with_a_team_are_told_by_their_looks(tmp_path: Path) -> None:
    assert not plain.sniff(tmp_path) and not plain.sniff(tmp_path / "nothing")
    assert plain.sniff(folder(tmp_path)) and not plain.sniff(tmp_path / "team.toml")


@given(st.data())
@settings(max_examples=150)
def test_no_file_brings_the_reader_down(data: st.DataObject) -> None:
    with TemporaryDirectory() as name:
        path = documented_example(Path(name))
        if data.draw(st.booleans()):
            plain.write(plain.read(path), path / "written")
            path = path / "written"
        files = sorted(p for p in path.iterdir() if p.is_file())
        for _ in range(data.draw(st.integers(1, 2))):
            file = data.draw(st.sampled_from(files))
            content = file.read_bytes()
            text = content.decode("utf-8", "replace").replace(",", " , ")
            if data.draw(st.booleans()):
                file.write_bytes(data.draw(damaged_text(text)).replace(b" , ", b","))
            else:
                file.write_bytes(data.draw(damaged_bytes(content)))
        with suppress(TeamslamError):
            assert isinstance(plain.read(path), Dataset)


def test_every_file_is_needed(tmp_path: Path) -> None:
    names = sorted(p.name for p in documented_example(tmp_path).iterdir())
    for name in names:
        path = tmp_path / "copy"
        shutil.rmtree(path, ignore_errors=True)
        path.mkdir()
        (documented_example(path) / name).unlink()
        with pytest.raises(InputError, match=f"{re.escape(name)}: no such file"):
            plain.read(path)


# --- slips of the hand ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("wrong", ["0", "-2"])
def test_a_range_that_is_none_is_refused_with_its_line(tmp_path: Path, wrong: str) -> None:
    """Sensors write 0 where they saw nothing."""
    text = LANDMARKS + f"1,7,{wrong},0.5\n"
    with pytest.raises(InputError, match=rf"line 4, field 'range': a range is above 0, found {wrong} \(1 of 3"):
        plain.read(folder(tmp_path, landmarks=text))


def test_angles_beyond_a_whole_turn_are_noted(tmp_path: Path) -> None:
    """With file, line, how many, and the cure; a full circle is none."""
    assert plain.read(folder(tmp_path / "a", landmarks="stamp,landmark,range,bearing\n0,7,2,6.28\n")).notes == ()
    (note,) = plain.read(folder(tmp_path / "b", landmarks="stamp,landmark,range,bearing\n0,7,2,1\n1,7,2,45\n")).notes
    assert "landmarks.csv, line 3, field 'bearing': found 45" in note and "1 of 2 rows" in note and "pi / 180" in note


@pytest.mark.parametrize(
    ("stamp", "unit"), [("1.7e18", "nanoseconds"), ("1.7e15", "microseconds"), ("1.7e12", "milliseconds")]
)
def test_stamps_in_parts_of_seconds_are_told(tmp_path: Path, stamp: str, unit: str) -> None:
    """Those of today's clocks are known by their size."""
    with pytest.raises(InputError, match=f"looks like {unit} since 1970; divide all times by"):
        plain.read(folder(tmp_path, landmarks=f"stamp,landmark,range,bearing\n{stamp},7,2,0.5\n"))


def test_a_file_in_two_logs_is_refused(tmp_path: Path) -> None:
    """Its rows would count twice."""
    again = TEAM + '[[log]]\nfile = "./landmarks.csv"\nmodel = "range_bearing"\nrobot = "red"\nsigma = [0.1, 0.02]\n'
    with pytest.raises(InputError, match="stands in another"):
        plain.read(folder(tmp_path, team=again))


def test_a_truth_at_other_times_is_noted(tmp_path: Path) -> None:
    """With both spans."""
    team = TEAM + '[truth]\nrobots = "truth.csv"\n'
    log = plain.read(folder(tmp_path, team=team, truth="robot,stamp,x,y,theta\nred,1000,0,0,0\nred,1001,1,0,0\n"))
    assert (
        "truth.csv: robot red is at 1000.000 to 1001.000 s here, and its poses are at 0.000 to 2.000 s" in log.notes[0]
    )
