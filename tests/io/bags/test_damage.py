"""Damaged recordings: one clear error, or what could be read and a count of what could not. Never anything else."""

import numpy as np
import pytest

import recordings
from teamslam.errors import InputError
from teamslam.io.bags import contents, opened, proposal, read_corners, read_track

START = 1_700_000_000 * 10**9
COUNT = 40


@pytest.fixture(scope="module", params=recordings.KINDS)
def whole(request, tmp_path_factory):
    """The bytes of a good recording, and the name of its file."""
    folder = tmp_path_factory.mktemp("whole")
    corners = np.array([[10, 50], [50, 50], [50, 10], [10, 10.0]])
    messages = [
        message
        for k in range(COUNT)
        for message in (
            recordings.odometry("/odom", START + k * 10**8, (k, 0, 0)),
            recordings.detections("/tags", START + k * 10**8 + 1, [(k, corners)]),
        )
    ]
    path = recordings.write(folder, request.param, messages)
    file = path if path.is_file() else next(p for p in path.iterdir() if p.suffix in (".mcap", ".db3"))
    return file.read_bytes(), file.name


def read_all(path):
    """How much of each topic comes, with what was counted as lost; InputError is the other allowed end."""
    found = contents(path)
    assert proposal(found)
    lost = sum(d.count for d in found.dropped)
    with opened(path) as recording:
        if "/odom" in recording.topics and "/tags" in recording.topics:
            sizes = len(read_track(recording, "/odom")), len(read_corners(recording, "/tags").frames)
            return sizes, lost, sum(d.count for d in recording.dropped)
    return (0, 0), lost, 0


def test_a_file_by_itself_is_read_whole(tmp_path, whole):
    (tmp_path / whole[1]).write_bytes(whole[0])
    assert read_all(tmp_path / whole[1]) == ((COUNT, COUNT), 0, 0)


@pytest.mark.parametrize("share", [0.0, 0.02, 0.3, 0.7, 0.99])
def test_cut_short(tmp_path, whole, share):
    path = tmp_path / whole[1]
    path.write_bytes(whole[0][: int(share * len(whole[0]))])
    try:
        sizes, _, lost = read_all(path)
    except InputError as error:
        assert str(path) in str(error) and "recording" in str(error)
    else:
        assert sum(sizes) + lost >= 2 * COUNT or share == 0.0


@pytest.mark.parametrize("seed", range(20))
def test_bytes_that_fell_over(tmp_path, whole, seed):
    rng = np.random.default_rng(seed)
    damaged = bytearray(whole[0])
    for _ in range(rng.integers(1, 30)):
        at = int(rng.integers(len(damaged)))
        size = int(rng.integers(1, 40))
        damaged[at : at + size] = rng.bytes(size)
    path = tmp_path / whole[1]
    path.write_bytes(damaged)
    try:
        read_all(path)
    except InputError as error:
        assert str(path) in str(error)


@pytest.mark.parametrize("name", ["nothing.bag", "nothing.mcap", "nothing.db3"])
def test_an_empty_file_and_one_of_something_else(tmp_path, name):
    path = tmp_path / name
    for content in (b"", b"this is no recording\n" * 50):
        path.write_bytes(content)
        with pytest.raises(InputError, match="cannot be opened"):
            contents(path)


def test_no_file(tmp_path):
    with pytest.raises(InputError, match="no such recording"):
        contents(tmp_path / "away.bag")
