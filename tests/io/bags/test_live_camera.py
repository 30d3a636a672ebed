"""A camera that films now gives the rows that its film gives as a recording. No camera is here: a film, and a named
pipe, play it."""

import os
import threading
from pathlib import Path

import numpy as np
import pytest

import teamslam as ts
from live_film import FRAMES, shot, team
from teamslam.errors import InputError
from teamslam.io.bags.live_camera import LiveCamera
from teamslam.model import Table

pytest.importorskip("cv2")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return shot(tmp_path_factory.mktemp("hand"))


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def together(tables: list[Table], source: str) -> tuple[np.ndarray, ...]:
    mine = [t for t in tables if t.source == source]
    return tuple(np.concatenate([getattr(t, name) for t in mine]) for name in ("keys", "values", "whitening", "ids"))


@pytest.mark.parametrize(("every", "device"), [(0.0, "film"), (0.25, "film"), (0.25, "pipe")])
def test_a_film_is_the_same_rows_as_it_is_shot_and_as_a_recording(folder: Path, every: float, device: str) -> None:
    path = team(folder, every)
    played = str(folder / "film.avi")
    if device == "pipe":
        pipe = folder / "pipe"
        os.mkfifo(pipe)
        threading.Thread(target=lambda: pipe.write_bytes(Path(played).read_bytes()), daemon=True).start()
        played = str(pipe)
    camera = LiveCamera(path, played)
    live = list(camera.rows())
    recorded = ts.read(path)
    stamps = [stamp for stamp, _ in live]
    assert len(live) == (FRAMES if every == 0.0 else FRAMES // 2) and stamps == sorted(stamps)
    tables = [table for _, moment in live for table in moment]
    for source in ("odometry", "landmarks"):
        mine, theirs = together(tables, source), together(list(recorded.tables), source)
        order = [np.lexsort(of[0].T) for of in (mine, theirs)]
        for one, other in zip(mine[:3], theirs[:3], strict=True):
            np.testing.assert_array_equal(one[order[0]], other[order[1]])
    channels = [(t.source, t.kind, t.loss) for t in camera.head.tables]
    assert channels == [(t.source, t.kind, t.loss) for t in recorded.tables]


def test_images_exposed_before_a_film_begins_are_counted(folder: Path) -> None:
    """Stamps of a film begin at 0, and a camera that stamps late exposed its first image before."""
    late = folder / "late.toml"
    late.write_text(team(folder, 0.0).read_text().replace("delay_s = -0.02", "delay_s = 0.02"))
    log = ts.read(late)
    assert len(log.pose_keys[1]) == FRAMES - 1
    assert [(lost.count, "exposed before 0 s" in lost.reason) for lost in log.dropped] == [(2, True)]
    assert len(list(LiveCamera(late, str(folder / "film.avi")).rows())) == FRAMES - 1


def test_what_is_no_camera_is_told(folder: Path) -> None:
    path = team(folder, 0.25)
    with pytest.raises(InputError, match="no camera films at"):
        list(LiveCamera(path, str(folder / "nothing.avi")).rows())
    other = folder / "other.toml"
    other.write_text(path.read_text().replace('recording = "film.avi"', 'recording = "film.avi"\nodometry = "/odom"'))
    with pytest.raises(InputError, match="without odometry"):
        LiveCamera(other, "0")
