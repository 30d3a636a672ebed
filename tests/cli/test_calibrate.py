"""A camera calibrated from the command line: filmed in the virtual lab, written, and read by a team file."""

import json

import pytest

from teamslam.io.bags.calibration import read_camera

pytest.importorskip("cv2")


def test_a_board_is_filmed_and_its_camera_found(teamslam, tmp_path):
    assert teamslam("film", tmp_path / "lab", "--preset", "board", "--seconds", 40, "--images-hz", 0.25).code == 0
    lab = tmp_path / "lab"
    called = teamslam(
        "calibrate", lab / "board.avi", "--board", lab / "board.toml", "--out", lab / "mine.yaml", "--json"
    )
    found = json.loads(called.out)
    truth, mine = read_camera(lab / "truth.yaml"), read_camera(lab / "mine.yaml")
    assert called.code in (0, 1) and found["views"] >= 8
    assert abs(mine.focal[0] - truth.focal[0]) < 4.0 * found["focal_sigma"]["stated"] < 40.0
    assert mine.size == truth.size and (lab / "mine.png").stat().st_size > 10_000
    again = teamslam("calibrate", lab / "board.avi", "--board", lab / "board.toml", "--out", lab / "mine.yaml")
    assert again.code == 2 and "something already" in again.err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((), "say which board"),
        (("--charuco", "8x6"), "needs --square-m and --marker-m"),
        (("--charuco", "eight", "--square-m", 1, "--marker-m", 0.5), "written as 8x6, found 'eight'"),
        (("--aprilgrid", "6x6"), "needs --tag-m"),
        (("--aprilgrid", "6x6", "--tag-m", 0.1), "no such file or folder"),
        (("--aprilgrid", "6x6", "--tag-m", 0.1, "--model", "omni"), "unknown model 'omni'"),
    ],
)
def test_what_cannot_be_calibrated_is_refused(options, words, teamslam, tmp_path):
    called = teamslam("calibrate", tmp_path / "no.mp4", "--out", tmp_path / "camera.yaml", *options)
    assert called.code == 2 and words in called.err and not list(tmp_path.iterdir())


def test_damaged_images_are_told(teamslam, tmp_path):
    board = "--aprilgrid", "6x6", "--tag-m", 0.1, "--out", tmp_path / "camera.yaml"
    for name, content, words in (
        ("none.mp4", b"", "not a video that can be read"),
        ("cut.avi", b"RIFF\x00\x00\x00\x00AVI LIST", "video"),
        ("text.png", b"no image", "seen in none of 1 images"),
    ):
        (tmp_path / name).write_bytes(content)
        called = teamslam("calibrate", tmp_path / name, *board)
        assert called.code == 2 and words in called.err, called.err
    (tmp_path / "empty").mkdir()
    called = teamslam("calibrate", tmp_path / "empty", *board)
    assert called.code == 2 and "no images in it" in called.err
