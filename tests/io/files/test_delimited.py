"""Files read at once and cell by cell: the same numbers, words, lines and complaints, whatever stands in them."""

import struct
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from teamslam.errors import InputError
from teamslam.io.files.csv_file import Csv
from teamslam.io.files.delimited import any_columns, any_csv, plain_columns, plain_csv, read_columns, read_csv
from teamslam.io.files.grid import decoded

NAMED = ("robot", "landmark")
HEADER = ("stamp", "robot", "x", "landmark", "y")

floats = st.floats(allow_nan=False, allow_infinity=False)
plain_numbers = st.one_of(
    floats.map(repr),
    floats.map("{:.17e}".format),
    st.floats(-1e9, 1e9).map("{:.6f}".format),
    st.integers(-(10**40), 10**40).map(str),
    st.from_regex(r"-?(0|[1-9][0-9]{0,25})(\.[0-9]{1,40})?([eE][-+]?[0-9]{1,2})?", fullmatch=True),
)
odd_numbers = st.sampled_from(
    ["-0", "-0.0", "+1", ".5", "1.", "1_0", "nan", "inf", "1e400", "", "x", "1,5", "0x10", "٣", "[1]", "1],[2", "null",
     "true", "1 2", "1e5", "007", "-", '"3"', "\t7", "7\x0b", "9007199254740993", "1e-400"]
)  # fmt: skip
names = st.one_of(
    st.sampled_from(["1", "2", "03", "north", "tag 7", "Zoë", "1.0", "-0"]),
    st.text(st.characters(codec="utf-8", exclude_characters=',;\t\n\r"#\0', exclude_categories=["Cs"]), max_size=6),
)
odd_names = st.sampled_from(["", " ", "#1", '"a"', '"a,b"', '"a""b"', 'a"b', "x" * 70, "a\0", "a\x1cb", "a\u2028b"])
blanks = st.sampled_from(["", "", "", " ", "  ", "\t", "\u00a0"])
sparse_lines = st.lists(st.sampled_from(["", "# a note", "#", "  # x;y;z", " ", '# "', "# é", ",,,,", "#\u2028a;b"]))


@st.composite
def csv_texts(draw: st.DrawFn, numbers: st.SearchStrategy[str], words: st.SearchStrategy[str]) -> str:
    """A CSV file of some of the columns, with comments and blanks; most of the rows as long as the header."""
    separator = draw(st.sampled_from(",;\t"))
    columns = draw(st.lists(st.sampled_from(HEADER), min_size=1, max_size=5, unique=True))
    header = [draw(blanks) + name for name in columns]
    rows = [header]
    for _ in range(draw(st.integers(0, 6))):
        cells = [draw(words if name in NAMED else numbers) for name in columns]
        rows.append([draw(blanks) + cell + draw(blanks) for cell in cells])
    if draw(st.integers(0, 9)) == 0:
        rows[draw(st.integers(0, len(rows) - 1))].append("1")
    end = draw(st.sampled_from(["\n", "\n", "\r\n", "\r"]))
    lines = draw(sparse_lines) + [separator.join(row) for row in rows]
    if draw(st.integers(0, 4)) == 0:
        place = draw(st.integers(0, len(lines)))
        lines[place:place] = draw(sparse_lines)
    return draw(st.sampled_from(["", "\ufeff"])) + end.join(lines) + end * draw(st.integers(0, 3))


def bits(numbers: np.ndarray) -> list[bytes]:
    return [struct.pack("d", number) for number in numbers.ravel().tolist()]


def outcome(ask: Callable[[], Any]) -> Any:
    """What is answered, or the complaint."""
    try:
        return ask()
    except InputError as error:
        return str(error)


def told(read: Callable[[], Csv]) -> Any:
    """All that a reader says of a file."""

    def whole() -> Any:
        csv = read()
        columns = [
            (name, outcome(lambda name=name: (csv.words(name).names, csv.words(name).codes.tolist())))
            if name in NAMED
            else (name, outcome(lambda name=name: bits(csv.numbers(name))))
            for name in csv.columns
        ]
        return columns, csv.lines.tolist(), len(csv)

    return outcome(whole)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("delimited") / "file.csv"


def write(file: Path, text: str | bytes) -> None:
    file.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8", "surrogatepass"))


@given(csv_texts(plain_numbers, names))
@settings(max_examples=300)
def test_a_csv_file_reads_the_same_at_once_and_cell_by_cell(file: Path, text: str) -> None:
    write(file, text)
    assert told(lambda: read_csv(file, words=NAMED)) == told(lambda: any_csv(file))


@given(csv_texts(plain_numbers | odd_numbers, names | odd_names))
@settings(max_examples=500)
@example("# c\rstamp,x\n1,2\n3,4\n")
@example("stamp;x\n1,5;2,5\n")
@example("stamp,x\n1],[2,3\n")
@example("x\n1,2\n\n3\n")
@example("robot,landmark\n1,\n,\n")
@example("stamp,stamp\n1,2\n")
@example("\ufeff\ufeffstamp\n1\n")
def test_so_does_an_odd_one(file: Path, text: str) -> None:
    write(file, text)
    assert told(lambda: read_csv(file, words=NAMED)) == told(lambda: any_csv(file))


@given(st.data())
@settings(max_examples=300)
def test_so_does_a_damaged_one(file: Path, data: st.DataObject) -> None:
    content = bytearray(data.draw(csv_texts(plain_numbers, names)).encode("utf-8", "surrogatepass"))
    for _ in range(data.draw(st.integers(1, 3))):
        if content:
            content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    write(file, bytes(content))
    assert told(lambda: read_csv(file, words=NAMED)) == told(lambda: any_csv(file))


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("top", ["", "\ufeff", "# a note\n\n# another\n"])
def test_what_pandas_and_spreadsheets_write_is_read_at_once(tmp_path: Path, separator: str, end: str, top: str) -> None:
    """So that the law above is one of two readers, and not of one."""
    rows = [("stamp", "robot", "x"), ("0.5", "north", "-1e-3"), ("1.0", "2", "17")]
    text = top.replace("\n", end) + end.join(map(separator.join, rows)) + end
    found = plain_csv(text.encode().removeprefix(b"\xef\xbb\xbf"), tmp_path / "a.csv", NAMED)
    assert found is not None
    assert found.numbers("stamp", "x").tolist() == [[0.5, -1e-3], [1.0, 17.0]]
    assert found.words("robot").names == ("north", "2")
    first = top.count("\n") + 2
    assert found.lines.tolist() == [first, first + 1]


@given(st.lists(plain_numbers))
def test_numbers_are_read_as_python_reads_them(words: list[str]) -> None:
    """To the bit, but for the sign of zero; what is beyond all numbers is left to the reader of cells."""
    found, meant = decoded(words), np.array([float(word) for word in words])
    if np.isfinite(meant).all():
        assert found is not None and bits(found) == bits(meant + 0.0)
    else:
        assert found is None


@given(st.lists(plain_numbers | odd_numbers, min_size=1))
def test_odd_words_are_numbers_only_where_python_says_so(words: list[str]) -> None:
    if (found := decoded(words)) is not None:
        assert bits(found) == bits(np.array([float(word) for word in words]) + 0.0)


# --- columns between blanks -------------------------------------------------------------------------------------------

FIELDS = ("time", "x", "y")


@st.composite
def column_texts(draw: st.DrawFn, numbers: st.SearchStrategy[str]) -> str:
    gap, end = st.sampled_from([" ", "  ", "\t", " \t "]), draw(st.sampled_from(["\n", "\n", "\r\n", "\r"]))
    lines = draw(sparse_lines)
    for _ in range(draw(st.integers(0, 6))):
        cells = [draw(numbers) for _ in FIELDS]
        if draw(st.integers(0, 19)) == 0:
            cells = cells[draw(st.integers(-1, 1)) :]
        row = "".join(draw(gap) + cell for cell in cells)
        lines.append(row.lstrip() if draw(st.booleans()) else row + draw(gap))
        lines += draw(st.sampled_from([[], [], [], [], [""], ["# note"]]))
    return draw(st.sampled_from(["", "\ufeff"])) + end.join(lines) + draw(st.sampled_from(["", end]))


def columns_told(read: Callable[[Path, Sequence[str]], Any], file: Path) -> Any:
    def whole() -> Any:
        found = read(file, FIELDS)
        return found.values.shape, bits(found.values), found.lines.tolist()

    return outcome(whole)


@given(column_texts(plain_numbers) | column_texts(plain_numbers | odd_numbers))
@settings(max_examples=500)
@example("1 2\n3\n4 5 6\n")
@example("1 2 3 4 5 6\n")
@example("1 2 3\x1c\n")
@example("1 2 3\x01\n")
@example("1 2\x0e3\n")
@example("1 2 3\n\x004 5 6")
def test_columns_read_the_same_at_once_and_line_by_line(file: Path, text: str) -> None:
    write(file, text)
    assert columns_told(read_columns, file) == columns_told(any_columns, file)


@given(st.data())
@settings(max_examples=300)
def test_so_do_damaged_columns(file: Path, data: st.DataObject) -> None:
    content = bytearray(data.draw(column_texts(plain_numbers)).encode())
    if content:
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    write(file, bytes(content))
    assert columns_told(read_columns, file) == columns_told(any_columns, file)


def test_columns_as_published_logs_have_them_are_read_at_once() -> None:
    text = b"# Time [s]    x [m]\n# twice\r\n1248272272.841 \t 0.5\t-2\r\n\n 1248272273.1    1e-3 7  \n"
    found = plain_columns(text, 3)
    assert found is not None
    assert found.values.tolist() == [[1248272272.841, 0.5, -2.0], [1248272273.1, 1e-3, 7.0]]
    assert found.lines.tolist() == [3, 5]
