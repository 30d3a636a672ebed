"""A file is whole or not there, and who may read its folder may read it."""

import os
import stat
import sys
from pathlib import Path

import pytest

from teamslam.io.files.whole import beside, whole_file


def test_what_is_written_is_there_and_nothing_else(tmp_path: Path) -> None:
    with whole_file(tmp_path / "deep" / "file") as file:
        file.write(b"old")
    with whole_file(tmp_path / "deep" / "file") as file:
        file.write(b"new")
        assert (tmp_path / "deep" / "file").read_bytes() == b"old"
    assert (tmp_path / "deep" / "file").read_bytes() == b"new"
    assert [p.name for p in (tmp_path / "deep").iterdir()] == ["file"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_on_any_error_what_was_there_stays(tmp_path: Path, error: type[BaseException]) -> None:
    (tmp_path / "file").write_bytes(b"old")
    with pytest.raises(error), whole_file(tmp_path / "file") as file:
        file.write(b"half")
        raise error
    assert (tmp_path / "file").read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_no_two_drafts_share_a_name(tmp_path: Path) -> None:
    assert beside(tmp_path / "file") != beside(tmp_path / "file")
    assert beside(tmp_path / "file").parent == tmp_path


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no umask")
@pytest.mark.parametrize("mask", [0o022, 0o027, 0o077])
def test_the_users_umask_says_who_may_read(tmp_path: Path, mask: int) -> None:
    before = os.umask(mask)
    try:
        with whole_file(tmp_path / "file") as file:
            file.write(b"new")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "file").stat().st_mode) == 0o666 & ~mask
