"""Text files of records: lines by their tags, with every value's place."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from teamslam.errors import InputError
from teamslam.io.files.records import Records, first_tag, read_records
from teamslam.io.files.text import rows_of_text, write_text


def lines(folder: Path, text: str) -> dict[str, Records]:
    path = folder / "log.txt"
    path.write_bytes(text.encode())
    return {records.tag: records for records in read_records(path)}


def test_lines_by_tag_with_their_places(tmp_path: Path) -> None:
    found = lines(tmp_path, "﻿A 1 2\r\n\n# a comment\nB 3\n  A 4 5 # another\n\tA 6 7")
    assert list(found) == ["A", "B"]
    assert found["A"].lines.tolist() == [1, 5, 6] and found["A"].column(1) == ["2", "5", "7"]
    assert found["A"].floats(0, ("x", "y")).tolist() == [[1, 2], [4, 5], [6, 7]]
    assert [len(part) for part in lines(tmp_path, "A 1\nA 1 2\nA 3\n")["A"].by_length()] == [2, 1]


def test_upper_triangles(tmp_path: Path) -> None:
    matrix = lines(tmp_path, "M 0 1 2 3 4 5 6\n")["M"].symmetric(1, 3, "M")
    assert matrix.tolist() == [[[1, 2, 3], [2, 4, 5], [3, 5, 6]]]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("A 1 2\nA 1 x\n", "log.txt, line 2, field 'y': expected a number, found 'x'"),
        ("A 1 2\nA nan 2\n", "line 2, field 'x': expected a finite number, found 'nan'"),
        ("A 1 1e200\n", "line 1, field 'y': expected a finite number"),
        ("A 1,5 2\n", "line 1, field 'x': expected a number, found '1,5' (decimal commas are not read: write a point)"),
        ("A 1 2024-05-01T00:00:01\n", "(dates and times of day are not read: write seconds since any start"),
        ("A 1 12:00:59.5\n", "found '12:00:59.5' (dates and times of day are not read: write seconds since any start"),
        ("A 1 29.03.2026\n", "found '29.03.2026' (dates and times of day are not read: write seconds since any start"),
        ("A 1 3/29/2026\n", "found '3/29/2026' (dates and times of day are not read: write seconds since any start"),
    ],
)
def test_words_that_are_no_numbers(text: str, problem: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        lines(tmp_path, text)["A"].floats(0, ("x", "y"))
    assert problem in str(caught.value)


@pytest.mark.parametrize("word", ["-1", "1.5", "x", "9223372036854775808", "1e3"])
def test_words_that_are_no_ids(word: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="line 2, field 'id': expected a whole number"):
        lines(tmp_path, f"A 1\nA {word}\n")["A"].integers(0, "id")


def test_the_largest_id(tmp_path: Path) -> None:
    assert lines(tmp_path, f"A {2**63 - 1}\n")["A"].integers(0, "id").tolist() == [2**63 - 1]


def test_a_line_of_another_length_shows_a_good_one(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="line 2: A needs 1 or 3 words after the tag, found 2; write 'A x'"):
        lines(tmp_path, "A 1\nA 1 2\n")["A"].check_length(1, 3, form="A x")


def test_a_file_is_told_by_its_first_word(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("# x\n\nVERTEX2 0 0 0 0\n")
    (tmp_path / "b").write_bytes(bytes(range(256)))
    (tmp_path / "c").write_text("# nothing\n")
    assert [first_tag(tmp_path / name) for name in ("a", "c", "d")] == ["VERTEX2", None, None]
    first_tag(tmp_path / "b")  # whatever it is, it is no error


@given(st.lists(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=2, max_size=2), min_size=1))
def test_numbers_read_back_to_the_same_bits(rows: list[list[float]]) -> None:
    text = rows_of_text(np.array(rows))
    assert [[float(word) for word in row.split()] for row in text] == rows


def test_a_text_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    def half() -> object:
        yield "first\n"
        raise RuntimeError("lost")

    with pytest.raises(RuntimeError):
        write_text(tmp_path / "out.txt", half())  # type: ignore[arg-type]
    assert list(tmp_path.iterdir()) == []
    write_text(tmp_path / "new" / "out.txt", ["a", "b\n"])
    assert (tmp_path / "new" / "out.txt").read_text() == "ab\n"
    with pytest.raises(InputError, match="cannot be written"):
        write_text(tmp_path / "new" / "out.txt" / "below", "x")
