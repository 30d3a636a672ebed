"""Folders that are whole or not there."""

from pathlib import Path

import pytest

from teamslam.results.whole import whole_folder


def test_an_interruption_while_folders_are_exchanged_keeps_the_old_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "mine").touch()
    rename = Path.rename

    def interrupted(path: Path, to: Path) -> Path:
        moved = rename(path, to)
        if path == tmp_path / "run":
            raise KeyboardInterrupt
        return moved

    monkeypatch.setattr(Path, "rename", interrupted)
    with pytest.raises(KeyboardInterrupt), whole_folder(tmp_path / "run"):
        pass
    assert [p.name for p in tmp_path.iterdir()] == ["run"] and (tmp_path / "run" / "mine").exists()
