"""Variables asked for in words: what is printed leads back, what is not there is told with what is."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from teamslam.errors import ModelError
from teamslam.model import Names, key_asked, landmark_asked, landmark_key, pose_asked, pose_key, robot_asked

words = st.text(st.characters(codec="utf-8", categories=["L", "N", "P", "Zs"]), min_size=1, max_size=12).filter(
    lambda w: w == w.strip() and w.isprintable() and "\\" not in w
)


@st.composite
def named_keys(draw: st.DrawFn) -> tuple[Names, np.ndarray]:
    """Robots and landmarks with names of their own, stamped or counted, and some of their keys."""
    called = draw(st.lists(words, min_size=2, max_size=8, unique=True))
    split = draw(st.integers(1, len(called) - 1))
    robots = {n: f"r{name}" for n, name in enumerate(called[:split], 1)}
    marks = dict(enumerate(called[split:], 10))
    counts = draw(st.booleans())
    ticks = np.array(draw(st.lists(st.integers(0, 10_000), min_size=1, max_size=5, unique=True)))
    ticks = np.sort(ticks) * (1 if counts else 1000)  # a millisecond apart, which is what is printed
    keys = [pose_key(robot, ticks) for robot in robots]
    return Names(robots, marks, 1.0 if counts else 1e-6), np.sort(
        np.concatenate([*keys, landmark_key(np.array([*marks]))])
    )


@given(named_keys())
@example((Names({1: "r0"}, {10: "@0"}), np.array([10, pose_key(1, 0)])))  # a landmark called as poses are asked for
def test_what_is_printed_of_a_variable_leads_back_to_it(drawn: tuple[Names, np.ndarray]) -> None:
    names, keys = drawn
    for key in keys.tolist():
        assert key_asked(names.describe(key), names, keys) == key == key_asked(key, names, keys)


@given(named_keys())
def test_names_stamps_first_last_and_nearest(drawn: tuple[Names, np.ndarray]) -> None:
    names, keys = drawn
    for number, name in names.robots.items():
        own = keys[keys >> 51 == number]
        assert robot_asked(name, names, keys) == number
        assert key_asked(f"{name}@first", names, keys) == own[0] and key_asked(f"{name}@last", names, keys) == own[-1]
        assert key_asked(f"{name}@~-5", names, keys) == own[0] and key_asked(f"{name}@~1e9", names, keys) == own[-1]
        for key, stamp in zip(own.tolist(), names.stamps_s(own).tolist(), strict=True):
            assert key_asked(f"{name}@{stamp:.6f}", names, keys) == key == pose_asked(name, stamp, names, keys)
    for number, name in names.landmarks.items():
        assert landmark_asked(name, names, keys) == number


@given(named_keys(), words)
def test_an_unknown_name_is_one_sentence_that_names_what_there_is(drawn: tuple[Names, np.ndarray], word: str) -> None:
    names, keys = drawn
    for ask in (key_asked, robot_asked, landmark_asked):
        try:
            ask(f"x{word}x", names, keys)
        except ModelError as error:
            assert "\n" not in str(error) and any(
                w in str(error) for w in ("did you mean", "there are", "there is", "no stamp")
            )


def test_a_landmark_with_an_at_in_its_name_is_one() -> None:
    names, keys = Names({1: "red"}, {5: "red@1"}, 1.0), np.array([5, *pose_key(1, np.arange(3)).tolist()])
    assert key_asked("red@1", names, keys) == 5 and key_asked("robot red@1", names, keys) == pose_key(1, 1)


@pytest.mark.parametrize("truth", [True, np.True_, 2.0, b"door"])
def test_a_thing_of_the_wrong_kind_is_told(truth: object) -> None:
    with pytest.raises(ModelError, match="found a"):
        key_asked(truth, Names(), np.array([0, 1]))  # type: ignore[arg-type]
