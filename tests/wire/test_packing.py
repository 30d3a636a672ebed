"""What was written is read back, whatever the numbers; what was cut short is refused."""

import contextlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.testing import assert_array_equal

from teamslam.errors import InputError
from teamslam.wire.packing import Reader, Writer

integers = st.one_of(st.integers(-3, 3), st.integers(-(2**62), 2**62 - 1))


@given(hnp.arrays(np.int64, st.integers(0, 40), elements=integers), st.integers(1, 5))
def test_integers_come_back(values: np.ndarray, groups: int) -> None:
    of_group = np.arange(len(values)) % groups
    out = Writer()
    out.integers(values, of_group)
    out.integers(values)
    source = Reader(out.content())
    assert_array_equal(source.integers(len(values), of_group), values)
    assert_array_equal(source.integers(len(values)), values)
    assert source.finished


@given(hnp.arrays(np.int64, st.tuples(st.integers(0, 20), st.integers(1, 4)), elements=st.integers(-(2**40), 2**40)))
def test_columns_come_back(values: np.ndarray) -> None:
    out = Writer()
    out.columns(values)
    assert_array_equal(Reader(out.content()).columns(*values.shape), values)


@given(st.integers(-(2**63), 2**63), st.integers(0, 2**64), st.text(), hnp.arrays(float, 5), st.floats())
def test_single_fields_come_back(signed: int, number: int, text: str, reals: np.ndarray, real: float) -> None:
    out = Writer()
    out.signed(signed)
    out.number(number)
    out.text(text)
    out.reals(reals)
    out.real(real)
    source = Reader(out.content())
    assert source.signed() == signed
    assert source.number() == number
    assert source.text() == text
    assert source.reals(5).tobytes() == reals.tobytes()
    assert np.array(source.real()).tobytes() == np.array(real).tobytes()


@pytest.mark.parametrize("sigma", [3.0, 50.0, 1e4])
def test_gaussian_integers_take_little_more_than_their_entropy(sigma: float) -> None:
    values = np.rint(np.random.default_rng(0).normal(scale=sigma, size=20_000)).astype(np.int64)
    counts = np.unique(values, return_counts=True)[1]
    entropy = -np.sum(counts * np.log2(counts / len(values))) / 8
    out = Writer()
    out.integers(values)
    assert len(out.content()) < 1.15 * entropy + 0.05 * len(values) / 8 + 20


@pytest.mark.parametrize("mean", [1.5, 12.0, 300.0])
def test_integers_none_of_which_is_negative_pay_for_no_sign(mean: float) -> None:
    """Lengths of stretches and of the gaps between them are drawn like this."""
    values = np.random.default_rng(0).geometric(1.0 / (mean + 1.0), size=20_000) - 1
    entropy = (np.log2(1.0 + mean) + mean * np.log2(1.0 + 1.0 / mean)) / 8.0 * len(values)
    out = Writer()
    out.integers(values)
    assert len(out.content()) < 1.05 * entropy + 20
    assert_array_equal(Reader(out.content()).integers(len(values)), values)


@given(st.binary(max_size=60), st.integers(1, 50))
def test_any_bytes_are_read_or_refused(data: bytes, count: int) -> None:
    for read in (lambda s: s.integers(count), lambda s: s.columns(count, 2), lambda s: s.reals(count), Reader.count):
        with contextlib.suppress(InputError):
            read(Reader(data))


def test_a_cut_message_is_refused() -> None:
    out = Writer()
    out.integers(np.arange(100))
    with pytest.raises(InputError, match="ends too soon"):
        Reader(out.content()[:-3]).integers(100)
    with pytest.raises(InputError, match="more than it has room for"):
        Reader(b"\xff\xff\xff\x7f").count()
