"""The table of formats: what is written reads back the same, and what fits nothing says so."""

from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from logs import ABILITIES, assert_rows_numbered_once, assert_same_log, logs
from teamslam.errors import InputError
from teamslam.io import FORMATS, SUBMAP_FORMATS, read, read_submaps, write, write_submaps


@pytest.mark.parametrize("name", ABILITIES)
@given(data=st.data())
@settings(max_examples=40)
def test_what_is_written_reads_back_the_same(name: str, data: st.DataObject) -> None:
    log = data.draw(logs(ABILITIES[name]))
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"log{FORMATS[name].suffixes[0]}"
        write(log, path)  # the format is told by the ending, when writing and when reading
        found = read(path)
    assert_same_log(found, log)
    assert_rows_numbered_once(found)


def test_every_format_that_writes_graphs_is_tested() -> None:
    assert {name for name, row in FORMATS.items() if row.writes and row.suffixes} == set(ABILITIES)


def test_every_row_has_its_functions() -> None:
    for row in [*FORMATS.values(), *SUBMAP_FORMATS.values()]:
        for name in ["sniff", "read", *(["write"] if row.writes else [])]:
            assert callable(row.function(name)), (row.module, name)


def test_a_path_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read(tmp_path / "nothing.g2o")


def test_a_file_of_no_known_format_lists_the_formats(tmp_path: Path) -> None:
    (tmp_path / "letter.docx").write_text("dear robot")
    with pytest.raises(InputError, match=r"(?s)none of the formats.*mrclam.*g2o"):
        read(tmp_path / "letter.docx")
    with pytest.raises(InputError, match=r"(?s)none of the formats.*linear"):
        read_submaps(tmp_path / "letter.docx")


def test_an_unknown_format_lists_the_formats(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"(?s)unknown format 'toro'.*g2o"):
        read(tmp_path, format="toro")


def test_a_format_that_is_only_read_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"(?s)does not write.*linear"):
        write_submaps([], tmp_path, "islsjf")


def test_an_unknown_option_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.g2o").write_text("VERTEX_SE2 0 0 0 0\n")
    with pytest.raises(InputError, match=r"no option 'charts'; did you mean 'chart'"):
        read(tmp_path / "a.g2o", charts="gtsam")
