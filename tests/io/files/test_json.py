"""JSON at once is JSON value by value: the same content, and the same error at the first value that is wrong."""

import gc
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from teamslam.errors import InputError
from teamslam.io.files.garbage import uncollected
from teamslam.io.files.json_column import JsonColumn
from teamslam.io.files.json_place import Json
from teamslam.io.files.json_text import decoded, encoded, finite

PATH = Path("log.json")
NUMBERS = st.one_of(
    st.integers(), st.floats(allow_nan=False, allow_infinity=False), st.sampled_from([1e100, 10**400, -(2**63), 2**64])
)
TEXTS = st.text(st.characters(exclude_categories=()), max_size=4)
VALUES = st.recursive(
    st.one_of(st.none(), st.booleans(), NUMBERS, TEXTS),
    lambda inner: st.one_of(
        st.lists(inner, max_size=3), st.dictionaries(st.one_of(st.just("x"), TEXTS), inner, max_size=3)
    ),
    max_leaves=6,
)
ALIKE = st.one_of(
    st.lists(st.one_of(NUMBERS, st.just(np.inf)), max_size=8),
    st.lists(st.integers(), max_size=8),
    st.lists(TEXTS, max_size=8),
    st.lists(st.lists(NUMBERS, min_size=2, max_size=2), max_size=8),
    st.lists(st.fixed_dictionaries({"x": VALUES}), max_size=8),
    st.lists(VALUES, max_size=8),
)


def outcome(work: Callable[[], Any]) -> Any:
    """What comes out of some work: its result or its error."""
    try:
        return work()
    except InputError as error:
        return str(error)


def pair(place: Json) -> list[float]:
    """Two numbers, as a matrix's row is read value by value."""
    numbers = [number.number() for number in place.elements()]
    if len(numbers) != 2:
        raise place.error(f"expected 2 numbers, found {len(numbers)}")
    return numbers


@given(ALIKE)
def test_a_column_holds_what_its_places_hold(values: list[Any]) -> None:
    places = [Json(PATH, f"rows[{k}]", value) for k, value in enumerate(values)]
    column = JsonColumn.of(PATH, places)
    assert outcome(lambda: column.numbers().tolist()) == outcome(lambda: [p.number() for p in places])
    assert outcome(lambda: list(column.wholes())) == outcome(lambda: [p.whole() for p in places])
    assert outcome(lambda: list(column.texts())) == outcome(lambda: [p.text() for p in places])
    assert outcome(lambda: seen(column.get("x"))) == outcome(lambda: [p.get("x") for p in places])
    assert outcome(lambda: seen(column.elements()[0])) == outcome(lambda: [e for p in places for e in p.elements()])
    assert column.have("x").tolist() == [p.has("x") for p in places]
    if all(isinstance(value, list) and len(value) == 2 for value in values):
        assert outcome(lambda: column.rows(2).tolist()) == outcome(lambda: [pair(p) for p in places])


def seen(column: JsonColumn) -> list[Json]:
    return [column.place(row) for row in range(len(column))]


@given(st.lists(st.lists(st.integers(0, 9), max_size=3), max_size=6), st.data())
def test_elements_know_their_list_and_number(lists: list[list[int]], data: st.DataObject) -> None:
    column, which, number = JsonColumn(PATH, lists, "lists[{}]".format).elements()
    assert [lists[a][b] for a, b in zip(which, number, strict=True)] == list(column.values)
    rows = np.array(data.draw(st.lists(st.booleans(), min_size=len(which), max_size=len(which))), bool)
    wheres = [f"lists[{a}][{b}]" for a, b in zip(which[rows], number[rows], strict=True)]
    assert [place.where for place in seen(column.select(rows))] == wheres


def test_a_row_of_the_wrong_length_is_named() -> None:
    with pytest.raises(InputError, match=r"field 'm\[1\]': expected 4 numbers \(a matrix 2 x 2\), found 3"):
        JsonColumn(PATH, [[1, 2, 3, 4], [1, 2, 3]], "m[{}]".format).rows(4, "a matrix 2 x 2")


@given(VALUES)
def test_what_is_encoded_is_decoded(content: Any) -> None:
    text = encoded(content)
    assert decoded(text) == json.loads(text) == json.loads(json.dumps(content))


@given(st.one_of(VALUES.map(json.dumps), st.text(st.sampled_from('[]{}",:0123.eE+-\\ud8 tfn\n\t'), max_size=12)))
def test_a_text_is_decoded_or_refused_as_by_the_standard_library(text: str) -> None:
    def loaded() -> Any:
        return json.loads(text)

    assert tried(lambda: decoded(text)) == tried(loaded)


def tried(work: Callable[[], Any]) -> Any:
    try:
        return work()
    except (ValueError, RecursionError) as error:
        return str(error)


@pytest.mark.parametrize("word", ["NaN", "Infinity", "-Infinity"])
def test_numbers_that_are_not_finite_have_no_word(word: str) -> None:
    with pytest.raises(ValueError, match=f"'{word}' stands where a finite number is needed"):
        decoded(f'{{"x": [{word}]}}')
    with pytest.raises(InputError, match="not finite"):
        finite(np.array([1.0, float(word)]))


def test_garbage_is_collected_again() -> None:
    with pytest.raises(KeyError), uncollected(), uncollected():
        assert not gc.isenabled()
        raise KeyError
    assert gc.isenabled()
