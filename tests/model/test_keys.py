"""Laws of keys: who and when, in one integer, and the same on every machine."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from teamslam.errors import ModelError
from teamslam.model import (
    WORLD,
    Names,
    index_of,
    is_landmark,
    is_pose,
    is_unnamed,
    landmark_key,
    landmark_number,
    pose_key,
    robot_of,
)
from teamslam.model.keys import twin_key

ROBOTS = st.integers(1, 4095)
INDICES = st.integers(0, 2**51 - 1)


@given(ROBOTS, INDICES)
def test_a_pose_key_tells_its_robot_and_index(robot: int, index: int) -> None:
    key = pose_key(robot, index)
    assert (robot_of(key), index_of(key)) == (robot, index)
    assert is_pose(key) and not is_landmark(key)
    assert key.dtype == np.int64 and key > 0


@given(INDICES)
def test_a_landmark_key_is_its_number(number: int) -> None:
    key = landmark_key(number)
    assert key == number == index_of(key)
    assert is_landmark(key) and not is_pose(key)


@given(st.lists(st.tuples(ROBOTS, INDICES), min_size=2, max_size=8))
def test_keys_sort_by_robot_then_time(pairs: list[tuple[int, int]]) -> None:
    keys = [int(pose_key(*pair)) for pair in pairs]
    assert sorted(keys) == [int(pose_key(*pair)) for pair in sorted(pairs)]


def test_keys_of_any_shape() -> None:
    keys = pose_key(np.array([[1], [2]]), np.arange(3))
    assert keys.shape == (2, 3)
    assert_array_equal(robot_of(keys), [[1, 1, 1], [2, 2, 2]])
    assert_array_equal(index_of(keys), [[0, 1, 2], [0, 1, 2]])
    assert pose_key(1, np.zeros(0, np.int64)).shape == (0,)


def test_the_world_is_neither_pose_nor_landmark() -> None:
    assert not is_pose(WORLD) and not is_landmark(WORLD)


@pytest.mark.parametrize("robot, index", [(0, 0), (4096, 0), (-1, 0), (1, -1), (1, 2**51)])
def test_what_does_not_fit_into_a_key_is_refused(robot: int, index: int) -> None:
    with pytest.raises(ModelError, match="run from"):
        pose_key(robot, index)


@pytest.mark.parametrize("number", [-1, 2**51])
def test_what_does_not_fit_into_a_landmark_is_refused(number: int) -> None:
    with pytest.raises(ModelError, match="run from"):
        landmark_key(number)


@given(st.integers(0, 2**50 - 1))
def test_a_landmark_called_by_a_number_has_that_number(number: int) -> None:
    assert landmark_number(str(number)) == landmark_number(f" {number} ") == number
    assert landmark_number(f"{number}.0") == landmark_number(f"{number}.") == landmark_number(f"{number}.000") == number
    assert landmark_number(f"{number}.5") != number != landmark_number(f"{number}.0.0")


@given(st.lists(st.text(min_size=1).filter(lambda s: not s.strip().isdigit()), max_size=50, unique_by=str.strip))
def test_named_landmarks_get_numbers_that_differ_and_fit(names: list[str]) -> None:
    numbers = [landmark_number(name) for name in names]
    assert len(set(numbers)) == len(names)
    assert all(2**50 <= number < 2**51 for number in numbers)


def test_a_name_has_the_same_number_on_every_machine() -> None:
    """Robots that never talked agree on 'door': the digest is BLAKE2b, not Python's salted hash."""
    import hashlib

    digest = int.from_bytes(hashlib.blake2b(b"door", digest_size=8).digest(), "little")
    assert landmark_number("door") == 2**50 + digest % 2**50


@pytest.mark.parametrize("digits", ["²", "१२", "٣", "99999999999999999999"])
def test_odd_digits_are_names(digits: str) -> None:
    assert landmark_number(digits) >= 2**50


def test_names_describe_variables_in_words() -> None:
    names = Names({3: "blue"}, {17: "door"}, tick_s=1e-6)
    assert names.describe(int(pose_key(3, 12_350_000))) == "robot blue at 12.350 s"
    assert names.describe(17) == "landmark door"
    assert names.describe(18) == "landmark 18"
    assert names.describe(WORLD) == "the world frame"
    assert Names(tick_s=1.0).describe(int(pose_key(2, 7))) == "robot 2 at pose 7"
    assert names.stamps_s(pose_key(3, np.array([0, 500_000]))).tolist() == [0.0, 0.5]


def test_names_of_several_logs_merge_unless_they_contradict() -> None:
    one, two = Names({1: "a"}, {5: "door"}), Names({2: "b"}, {5: "door"})
    merged = one.merge([two])
    assert (dict(merged.robots), dict(merged.landmarks)) == ({1: "a", 2: "b"}, {5: "door"})
    assert one.robots == {1: "a"}
    with pytest.raises(ModelError, match="robot number 1 is called 'a' in one log and 'c'"):
        one.merge([Names({1: "c"})])
    with pytest.raises(ModelError, match="landmark number 5"):
        one.merge([Names({}, {5: "gate"})])
    with pytest.raises(ModelError, match="tick"):
        one.merge([Names(tick_s=1.0)])


@given(st.one_of(INDICES, st.text().map(landmark_number)), st.text(max_size=20), st.text(max_size=20))
def test_twins_of_any_landmark_are_landmarks(mark: int, one: str, other: str) -> None:
    key = twin_key(mark, one)
    assert is_landmark(key) and not is_unnamed(key) and landmark_key(key) == key
    assert key != mark and key == twin_key(mark, one)
    assert (key == twin_key(mark, other)) == (one == other)
