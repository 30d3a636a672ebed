"""Columns of text hold what Python's own formatting writes, letter by letter."""

import csv
import io
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from teamslam.io.files.letters import Letters, fixed, integers, lines, significant, spelled, words


def texts(column: Letters) -> list[str]:
    return b"".join(lines([column])).decode().split("\n")[:-1]


ANY = st.one_of(
    st.floats(),
    st.floats(-10.0, 10.0),
    st.floats(-8.0, 8.0).map(lambda power: 10.0**power),
    st.builds(lambda whole, power: whole * 10.0**power, st.integers(-200_000, 200_000), st.integers(-9, 3)),
    st.builds(lambda half, power: (half + 0.5) * 10.0**power, st.integers(0, 99_999), st.integers(-9, 3)),
    st.sampled_from(
        [0.0, -0.0, 1.0, 1e308, -1e308, 5e-324, 9.99995, 99999.5, 1e-4, 9.99995e-5, 0.00012345, 1e5, 123456.0]
    ),
)


@given(st.lists(ANY, max_size=40), st.integers(1, 9))
def test_numbers_of_so_many_digits_are_those_of_python(numbers: list[float], digits: int) -> None:
    assert texts(significant(np.array(numbers, float), digits)) == [f"%.{digits}g" % number for number in numbers]


@given(st.integers(0, 2**32 - 1), st.sampled_from([4, 5]))
def test_many_numbers_of_all_sizes_are_those_of_python(seed: int, digits: int) -> None:
    rng = np.random.default_rng(seed)
    numbers = rng.normal(size=3000) * 10.0 ** rng.uniform(-7.0, 7.0, 3000)
    assert texts(significant(numbers, digits)) == [f"%.{digits}g" % number for number in numbers]


@given(st.lists(ANY, max_size=40), st.integers(1, 9))
def test_numbers_with_so_many_decimals_are_those_of_python(numbers: list[float], decimals: int) -> None:
    said = ["" if number != number else f"{number:.{decimals}f}" for number in numbers]
    assert texts(fixed(np.array(numbers, float), decimals)) == said


@given(st.integers(0, 2**32 - 1))
def test_stamps_are_those_of_python(seed: int) -> None:
    """Of a day and of the epoch, at whole and at half microseconds among them."""
    rng = np.random.default_rng(seed)
    ticks = rng.integers(0, 86_400_000_000, 3000) + rng.choice([0, 1_700_000_000_000_000], 3000)
    stamps = ticks / 1e6 + rng.choice([0.0, 0.5e-6, 1e-9], 3000)
    assert texts(fixed(stamps, 6)) == [f"{stamp:.6f}" for stamp in stamps.tolist()]


@given(st.lists(st.one_of(st.integers(0, 2**62), st.integers(0, 12), st.integers(-(2**62), -1)), max_size=40))
def test_whole_numbers_are_those_of_python(numbers: list[int]) -> None:
    assert texts(integers(np.array(numbers, np.int64))) == list(map(str, numbers))
    assert texts(spelled(np.array(numbers, np.int64), str)) == list(map(str, numbers))


@pytest.mark.parametrize("rows", [0, 1, 7, 20_000, 20_001, 50_000])
def test_columns_side_by_side_are_a_table(rows: int) -> None:
    """Empty cells and cells of any letters among them, however many rows."""
    rng = np.random.default_rng(rows)
    said = ["", "a", "\u00fc\u4e2d", '"x, y"']
    which, numbers = rng.integers(0, len(said), rows), rng.normal(size=rows)
    columns = [words(said, which), integers(np.arange(rows)), words([""], 0 * which), significant(numbers, 5)]
    whole = b"".join(lines(columns)).decode()
    found = list(csv.reader(io.StringIO(whole)))
    spell: Callable[[float], str] = "%.5g".__mod__
    cells = zip(
        [said[k].strip('"') for k in which], map(str, range(rows)), [""] * rows, map(spell, numbers), strict=True
    )
    assert found == list(map(list, cells))
