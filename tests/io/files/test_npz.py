"""Arrays in a file are those that numpy reads there."""

import ast
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from teamslam.io.files.npz import read_arrays, write_arrays
from teamslam.io.files.text import rows_of_text

some = arrays.arrays(st.sampled_from([np.float64, np.int64, np.int32, np.bool_]), arrays.array_shapes(min_dims=0))


@given(st.dictionaries(st.from_regex(r"[a-z_]{1,8}", fullmatch=True), some, max_size=4))
@settings(max_examples=30)
def test_numpy_reads_what_is_written(tmp_path_factory, found: dict[str, np.ndarray]) -> None:
    path: Path = tmp_path_factory.mktemp("npz") / "a.npz"
    write_arrays(path, found)
    with np.load(path, allow_pickle=False) as there:
        assert set(there) == set(found)
        for name, array in found.items():
            assert there[name].dtype == array.dtype
            np.testing.assert_array_equal(there[name], array)
            np.testing.assert_array_equal(read_arrays(path)[name], array)


def test_no_two_threads_parse_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What arrays are, which Python 3.11 cannot do."""
    write_arrays(tmp_path / "a.npz", {"a": np.arange(3), "b": np.ones((2, 2))})
    parse, inside, most = ast.parse, [], []

    def counted(*given, **more):
        inside.append(threading.get_ident())
        most.append(len(inside))
        time.sleep(1e-3)
        inside.pop()
        return parse(*given, **more)

    monkeypatch.setattr(ast, "parse", counted)
    with ThreadPoolExecutor(4) as team:
        found = list(team.map(lambda _: read_arrays(tmp_path / "a.npz"), range(20)))
    assert len(most) >= len(found) == 20 and max(most) == 1


@given(
    arrays.arrays(
        np.float64, st.tuples(st.integers(0, 4), st.integers(0, 4)), elements=st.floats(allow_subnormal=True)
    ),
    st.sampled_from([",", " "]),
)
def test_rows_of_text_read_back_to_the_bit_in_no_more_digits_than_it_takes(rows: np.ndarray, separator: str) -> None:
    lines = rows_of_text(rows, separator)
    assert len(lines) == len(rows)
    for line, row in zip(lines, rows.tolist(), strict=True):
        words = line.split(separator) if line else []
        assert np.array(list(map(float, words))).tobytes() == np.array(row).tobytes() or not np.isfinite(row).all()
        for word, number in zip(words, row, strict=True):
            assert repr(float(word)) == repr(number)
            assert len(_digits(word)) == len(_digits(repr(number)))


def _digits(word: str) -> str:
    return word.split("e")[0].replace(".", "").strip("-0")
