"""MRCLAM: a small made-up set in which every quirk has one right answer, damage, and the real sets."""

import re
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from damage import damaged_bytes, damaged_text
from logs import assert_rows_numbered_once
from teamslam.errors import InputError, TeamslamError
from teamslam.geometry import Pose
from teamslam.io import read
from teamslam.io.logs import mrclam
from teamslam.model import Dataset, Kind, index_of, landmark_key, pose_key

# Robot 1 drives straight ahead at 0.1 m/s from 1000 s on, robot 2 stands still; 63 is landmark 6, 14 robot 2.
FILES = {
    "Barcodes.dat": "# Subject #    Barcode #\n  1 \t   5 \n  2 \t  14 \n  6 \t  63 \n 7  81\n",
    "Robot1_Odometry.dat": "# Time [s]\n" + "".join(f"{1000 + k / 10:.3f} \t 0.100 \t 0.000 \n" for k in range(101)),
    "Robot2_Odometry.dat": "1000.000 0 0\n1005.000 0 0\n1010.000 0 0\n",
    "Robot1_Measurement.dat": (
        "# Time [s]    Subject #    range [m]    bearing [rad] \n"
        "1002.000 \t  63 \t  2.000 \t  0.100 \n"
        "1004.000  14  1.500 -0.200\n"
        "1006.001  63  1.600  0.120\n"
        "1006.002  81  1.700  0.300\n"
    ),
    "Robot2_Measurement.dat": "1008.000 5 1.2 0.5\n",
    "Robot1_Groundtruth.dat": "1000 0 0 3.0\n1009.99 1 0 3.2\n1010 1 0 3.2\n",
    "Robot2_Groundtruth.dat": "1003.9 5 5 3.1\n1004.1 5 6 -3.1\n",
    "Landmark_Groundtruth.dat": " 6 1.0 2.0 0.0001 0.0001\n 20 3.0 4.0 0.0001 0.0001\n",
}
PLAIN = {"odometry_lag_s": 0.0}


def folder(path: Path, **changed: str | None) -> Path:
    """The made-up set with some files (names without endings) changed or, where None, left out."""
    path.mkdir(exist_ok=True)
    for name, text in (FILES | {f"{stem}.dat": text for stem, text in changed.items()}).items():
        if text is not None:
            (path / name).write_text(text)
    return path


def ticks(dataset: Dataset, robot: int) -> list[float]:
    return (index_of(dataset.pose_keys[robot]) / 1e6).tolist()


def at(robot: int, seconds: float) -> int:
    return int(pose_key(robot, round(seconds * 1e6)))


def test_who_saw_whom_when(tmp_path: Path) -> None:
    found = mrclam.read(folder(tmp_path), PLAIN)
    assert found.robots == {1: 2, 2: 2} and found.dropped == ()
    # A pose for each image, and one for each time that somebody else saw the robot; images 1 ms apart are one.
    assert ticks(found, 1) == [1002.0, 1004.0, 1006.001, 1008.0]
    assert ticks(found, 2) == [1004.0, 1008.0]
    tables = {(t.robot, t.source): t for t in found.tables}
    assert tables[1, "landmarks"].keys.tolist() == [[at(1, 1002), 6], [at(1, 1006.001), 6], [at(1, 1006.001), 7]]
    assert tables[1, "landmarks"].values.tolist() == [[2.0, 0.1], [1.6, 0.12], [1.7, 0.3]]
    assert tables[1, "landmarks"].ids.tolist() == [0, 2, 3]  # rows of the measurement file
    assert tables[1, "robots"].keys.tolist() == [[at(1, 1004), at(2, 1004)]]
    assert tables[2, "robots"].keys.tolist() == [[at(2, 1008), at(1, 1008)]]
    assert all(t.model == "range_bearing" for key, t in tables.items() if key[1] != "odometry")
    assert np.allclose(tables[1, "odometry"].values[:, :2], [[0.2, 0], [0.2001, 0], [0.1999, 0]])


def test_commands_take_effect_late_and_images_are_taken_early(tmp_path: Path) -> None:
    turning = "1000 0.1 0\n1004 0.1 0.2\n1010 0 0\n"
    path = folder(tmp_path, Robot1_Odometry=turning)
    for options, turned_s in (
        ({"odometry_lag_s": 0.0}, 2.0),
        ({"odometry_lag_s": 0.5}, 1.5),  # from 1004.5 to 1006
        ({"odometry_lag_s": 0.0, "delay_s": 0.25}, 1.75),  # from 1004 to 1005.75
        ({"odometry_lag_s": 0.25, "delay_s": 0.25}, 1.5),  # only the sum is told apart
    ):
        found = mrclam.read(path, options)
        odometry = next(t for t in found.tables if (t.robot, t.source) == (1, "odometry"))
        turned = Pose(odometry.values[1, 2:].reshape(2, 2), np.zeros(2)).heading
        assert np.isclose(turned, 0.2 * (turned_s + 0.001))  # the image is of 1006.001 s


def test_one_image_in_a_while(tmp_path: Path) -> None:
    rows = "".join(f"{1002 + k / 4:.3f} 63 2 0.1\n" for k in range(9))
    found = mrclam.read(folder(tmp_path, Robot1_Measurement=rows), PLAIN)
    seen = next(t for t in found.tables if t.source == "landmarks")
    assert (index_of(seen.keys[:, 0]) / 1e6).tolist() == [1002.0, 1003.0, 1004.0]
    assert [(d.count, "less than 1 s" in d.reason) for d in found.dropped] == [(6, True)]
    found = mrclam.read(folder(tmp_path, Robot1_Measurement=rows), {**PLAIN, "image_every_s": 0.0})
    assert len(next(t for t in found.tables if t.source == "landmarks")) == 9 and found.dropped == ()


@pytest.mark.parametrize(
    ("changed", "count", "reason"),
    [
        ({"Robot1_Measurement": "1002 63 2 0\n1002 99 2 0\n"}, 1, "robot 1: sightings of unknown barcodes"),
        ({"Robot1_Measurement": "1002 63 2 0\n1002 5 2 0\n"}, 1, "robot 1: sightings of itself"),
        ({"Robot1_Measurement": "1002 63 2 0\n999 63 2 0\n"}, 1, "robot 1: sightings whose stamps step back"),
        ({"Robot1_Measurement": "1002 63 2 0\n1020 63 2 0\n"}, 1, "robot 1: sightings outside its odometry"),
        ({"Robot1_Measurement": "1002 63 -2 0\n1005 63 2 0\n"}, 1, "at a range of 0 or less"),
        ({"Robot2_Odometry": "1004.5 0 0\n1010 0 0\n"}, 1, "robot 1: sightings of robot 2 outside its odometry"),
        ({"Robot2_Odometry": None}, 1, "robot 1: sightings of robot 2, whose odometry file is absent"),
        ({"Robot2_Odometry": "1000 0 0\n1000 1 0\n1010 0 0\n"}, 1, "robot 2: repeated odometry stamps"),
        ({"Robot2_Odometry": "1000 0 0\n1007 0 0\n1003 0 0\n1004 0 0\n1010 0 0\n"}, 2, "robot 2: odometry stamps that"),
    ],
)
def test_rows_that_say_nothing_are_counted(
    tmp_path: Path, changed: dict[str, str | None], count: int, reason: str
) -> None:
    found = mrclam.read(folder(tmp_path, **changed), PLAIN)
    assert [(d.count, d.reason.startswith(reason) or reason in d.reason) for d in found.dropped] == [(count, True)]


def test_of_several_commands_at_one_stamp_the_last_one_holds(tmp_path: Path) -> None:
    found = mrclam.read(folder(tmp_path, Robot1_Odometry="1000 5 0\n1000 0.1 0\n1010 0 0\n"), PLAIN)
    odometry = next(t for t in found.tables if (t.robot, t.source) == (1, "odometry"))
    assert np.allclose(odometry.values[0, :2], [0.2, 0.0])


def test_truth_is_interpolated_across_short_holes_only(tmp_path: Path) -> None:
    found = mrclam.read(folder(tmp_path), PLAIN)
    assert found.truth is not None
    assert found.truth.layout.keys_of(Kind.POINT2).tolist() == [6]  # 20 was surveyed, but nobody saw it
    assert found.truth.positions(landmark_key(np.array([6])), 2).tolist() == [[1.0, 2.0]]
    assert found.truth.layout.keys_of(Kind.POSE2).tolist() == [at(2, 1004)]  # robot 1's samples are 10 s apart
    pose = found.truth.pose(at(2, 1004))
    assert np.allclose(pose.translation, [5.0, 5.5]) and np.isclose(abs(pose.heading), np.pi)


def test_truth_is_optional(tmp_path: Path) -> None:
    absent = dict.fromkeys(("Robot1_Groundtruth", "Robot2_Groundtruth", "Landmark_Groundtruth"), None)
    assert mrclam.read(folder(tmp_path, **absent)).truth is None


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"delay": 0.1}, "no option 'delay'; did you mean 'delay_s'"),
        ({"merge_s": -1.0}, "field 'merge_s': expected a number of 0 or more"),
        ({"landmark_range_m": 0}, "field 'landmark_range_m': expected a number above 0"),
        ({"delay_s": float("nan")}, "field 'delay_s'"),
        ({"loss": "hubert"}, "unknown loss 'hubert'"),
        ({"loss": 3}, "field 'loss': expected str, found 3"),
    ],
)
def test_options_are_checked(tmp_path: Path, options: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message).replace(r"\ ", " ")):
        mrclam.read(folder(tmp_path), options)


DAMAGE: dict[str, tuple[dict[str, str | None], str]] = {
    "no barcodes": ({"Barcodes": None}, r"Barcodes\.dat: no such file"),
    "empty barcodes": ({"Barcodes": "# nothing\n"}, r"Barcodes\.dat: no barcodes"),
    "a barcode twice": ({"Barcodes": "1 5\n2 14\n6 5\n"}, r"line 3, field 'barcode': barcode 5 stands twice"),
    "a subject twice": ({"Barcodes": "1 5\n1 14\n"}, r"line 2, field 'subject': subject 1 stands twice"),
    "half a barcode": ({"Barcodes": "1 5.5\n"}, r"line 1, field 'barcode': expected a whole number"),
    "no odometry": ({"Robot1_Odometry": None, "Robot2_Odometry": None}, r"no RobotN_Odometry\.dat here"),
    "no measurements": ({"Robot1_Measurement": None}, r"Robot1_Measurement\.dat: no such file"),
    "empty odometry": ({"Robot1_Odometry": ""}, r"Robot1_Odometry\.dat: expected at least two lines"),
    "a missing column": ({"Robot1_Odometry": "1000 0.1\n"}, r"line 1: expected 3 columns \(time.*found 2"),
    "a column too many": ({"Robot1_Measurement": "1000 63 2 0.1 7\n"}, r"line 1: expected 4 columns.*found 5"),
    "a truncated line": ({"Robot2_Odometry": FILES["Robot2_Odometry.dat"] + "1011"}, r"line 4: expected 3 columns"),
    "a word": ({"Robot1_Measurement": "1000 63 far 0\n"}, r"line 1, field 'range': expected a number, found 'far'"),
    "NaN": ({"Robot1_Odometry": "# t\n1000 nan 0\n"}, r"line 2, field 'forward velocity': 'nan' is not a finite"),
    "a huge number": ({"Robot1_Odometry": "1000 1e999 0\n"}, r"line 1, field 'forward velocity'.*not a finite"),
    "a time before 0": ({"Robot1_Odometry": "-5 0 0\n1 0 0\n"}, r"line 1, field 'time': expected a time in seconds"),
    "milliseconds": ({"Robot1_Odometry": "1000000000000 0 0\n"}, r"line 1, field 'time'.*year 2039"),
    "truth cut off": ({"Robot1_Groundtruth": "1000 0 0\n"}, r"Robot1_Groundtruth\.dat, line 1: expected 4 columns"),
    "landmarks cut off": ({"Landmark_Groundtruth": "6 0 0\n"}, r"Landmark_Groundtruth\.dat, line 1: expected 5"),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_damage_is_named_with_its_place(tmp_path: Path, damage: str) -> None:
    changed, message = DAMAGE[damage]
    with pytest.raises(InputError, match=message):
        mrclam.read(folder(tmp_path, **changed))


@pytest.mark.parametrize("name", FILES)
def test_binary_rubbish(tmp_path: Path, name: str) -> None:
    path = folder(tmp_path)
    for rubbish in (bytes(range(256)), b"\0\0\0\0"):
        (path / name).write_bytes(rubbish)
        with pytest.raises(InputError, match=f"{re.escape(name)}.*expected a text file"):
            mrclam.read(path)


@given(st.data())
@settings(max_examples=150)
def test_no_file_brings_the_reader_down(data: st.DataObject) -> None:
    with TemporaryDirectory() as name:
        path = folder(Path(name))
        for _ in range(data.draw(st.integers(1, 2))):
            file = data.draw(st.sampled_from(sorted(path.iterdir())))
            content = file.read_bytes()
            whole = data.draw(st.booleans())
            file.write_bytes(
                data.draw(damaged_text(content.decode("utf-8", "replace")) if whole else damaged_bytes(content))
            )
        with suppress(TeamslamError):
            assert isinstance(mrclam.read(path), Dataset)


# --- the real sets ------------------------------------------------------------------------------------------------


def test_a_real_set_is_told_by_its_looks_and_keeps_its_books(data: Callable[[str], Path]) -> None:
    path = data("mrclam_6")
    found = read(path, image_every_s=0.0)
    assert list(found.robots) == [1, 2, 3, 4, 5] and found.landmark_keys.tolist() == list(range(6, 21))
    lines = [line for file in path.glob("*_Measurement.dat") for line in file.read_text().splitlines()]
    rows = sum(not line.startswith("#") for line in lines)
    kept = sum(len(t) for t in found.tables if t.source != "odometry")
    left = sum(d.count for d in found.dropped if "sightings" in d.reason)
    assert kept + left == rows
    assert any("unknown barcodes" in d.reason for d in found.dropped)
    assert sum(d.count for d in found.dropped if "repeated odometry stamps" in d.reason) == 23
    assert_rows_numbered_once(found)


def test_the_noise_model_holds_against_motion_capture(data: Callable[[str], Path]) -> None:
    """Residuals at the truth, in the stated sigmas. The model was not made from the truth."""
    found = mrclam.read(data("mrclam_6"))
    assert found.truth is not None
    for source, rows in (("odometry", 3), ("landmarks", 2), ("robots", 2)):
        tables = [t for t in found.tables if t.source == source]
        whitened = np.concatenate(
            [t.select(found.truth.layout.contains(t.keys).all(-1)).whitened(found.truth) for t in tables]
        )
        robust_sigma = np.median(np.abs(whitened), 0) / 0.6745
        assert whitened.shape[1] == rows and len(whitened) > 500
        # Published figures and likelihoods, not fits to this truth: right to a factor of two.
        loosest = 0.25 if source == "odometry" else 0.5  # most arcs slip less than the likelihood's average
        assert ((robust_sigma > loosest) & (robust_sigma < 2.0)).all(), (source, robust_sigma)


def test_a_set_without_truth_of_robots(data: Callable[[str], Path]) -> None:
    found = mrclam.read(data("mrclam_1"))
    assert found.truth is not None and found.truth.layout.keys.tolist() == list(range(6, 21))
