"""Tags in images: of topics in every encoding, of folders, kept on the disk, gone on with after an interruption."""

from unittest import mock  # counts calls of the real detector, and replaces nothing

import cv2
import numpy as np
import pytest

import recordings
import teamslam as ts
from tag_pictures import picture, square
from teamslam.errors import InputError
from teamslam.frontend.tags import detect
from teamslam.frontend.tags.detect import Looking
from teamslam.io.bags import looked
from teamslam.io.bags.looked import tags_in
from teamslam.io.bags.opened import opened
from teamslam.io.bags.pictures import CHANNELS, pictures_of_folder, pictures_of_topic

TAGS = {3: square((50, 50), 60, 0.2), 8: square((120.5, 60.3), 50, -1.0)}
GREY = picture(TAGS, (170, 110), blur=0.5)


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "teamslam" / "tags"


def encoded(name):
    """GREY in an encoding, as a camera would send it."""
    plain = name.lower()
    if plain.endswith("16") or plain.startswith("16uc"):
        deep = np.repeat(GREY[..., None].astype("<u2") << 4, CHANNELS[plain], -1)
        return np.ascontiguousarray(deep).view(np.uint8).reshape(*GREY.shape, 2 * CHANNELS[plain])
    if plain.startswith("bayer"):
        return GREY  # a grey scene looks the same behind every filter
    if plain.startswith("nv"):
        return np.concatenate([GREY, np.full((55, 170), 128, np.uint8)])
    if CHANNELS[plain] == 2:
        grey_first = "yuy" in plain
        other = np.full_like(GREY, 128)
        return np.stack([GREY, other] if grey_first else [other, GREY], -1)
    return GREY if CHANNELS[plain] == 1 else np.repeat(GREY[..., None], CHANNELS[plain], -1)


@pytest.mark.parametrize("kind", ["bag", "mcap"])
def test_every_encoding_shows_the_same_tags(kind, tmp_path):
    names = [*CHANNELS, "RGB8"]
    messages = [recordings.image("/raw", 10**9 + k, encoded(name), name) for k, name in enumerate(names)]
    for k, ending in enumerate((".png", ".jpg")):
        data = cv2.imencode(ending, GREY)[1].tobytes()
        messages.append(recordings.compressed("/small", 10**9 * (k + 1), data, ending[1:]))
    path = recordings.write(tmp_path, kind, fix_nv(messages, names))
    with opened(path) as recording:
        raw = tags_in(pictures_of_topic(recording, "/raw"), Looking())
        small = tags_in(pictures_of_topic(recording, "/small"), Looking())
    for found, count in ((raw, len(names)), (small, 2)):
        assert not found.lost and found.size == (170, 110) and len(found.corners.frames) == count
        assert found.corners.ids.tolist() == [3, 8] * count
        off = found.corners.corners.reshape(count, 2, 4, 2) - np.array([TAGS[3], TAGS[8]])
        assert np.abs(off).max() < 0.25  # JPEG, and mosaics, take their share


def fix_nv(messages, names):
    """Images of NV12 say the height of the picture, not that of the bytes."""
    for k, name in enumerate(names):
        if name.startswith("nv"):
            topic, type_, stamp, make = messages[k]

            def shorter(store, header, make=make):
                found = make(store, header)
                found.height, found.step = 110, 170
                return found

            messages[k] = topic, type_, stamp, shorter
    return messages


def test_images_that_are_none_are_counted_and_the_rest_is_used(tmp_path):
    small = picture({}, (32, 32))
    messages = [
        recordings.image("/raw", 1 * 10**9, GREY),
        recordings.image("/raw", 2 * 10**9, GREY, "32FC1"),
        recordings.image("/raw", 3 * 10**9, GREY[:5], step=4000),
        recordings.image("/raw", 4 * 10**9, small),
        recordings.image("/raw", 5 * 10**9, GREY),
    ]
    path = recordings.write(tmp_path, "mcap", messages)
    with opened(path) as recording:
        found = tags_in(pictures_of_topic(recording, "/raw"), Looking())
    assert found.corners.frames.tolist() == [1_000_000, 5_000_000] and found.corners.ids.tolist() == [3, 8, 3, 8]
    assert found.corners.frame.tolist() == [0, 0, 1, 1]
    assert sorted(found.lost.values()) == [1, 1, 1]
    said = " ".join(found.lost)
    assert "'32FC1'" in said and "do not make an image" in said and "than 170 x 110" in said


@pytest.mark.parametrize(
    ("names", "rate", "ticks"),
    [
        (["1403636579763555584", "1403636579813555456"], None, [1403636579763555, 1403636579813555]),
        (["1305031102.175304", "1305031102.2"], None, [1305031102175304, 1305031102200000]),
        (["frame_10", "frame_9"], 10.0, [900_000, 1_000_000]),
    ],
)
def test_a_folder_of_images_and_its_stamps(names, rate, ticks, tmp_path):
    (tmp_path / "left").mkdir()
    for name in names:
        cv2.imwrite(str(tmp_path / "left" / f"{name}.png"), GREY)
    (tmp_path / "left" / "notes.txt").write_text("no image")
    found = tags_in(pictures_of_folder(tmp_path, "left/*.png", rate), Looking())
    assert found.corners.frames.tolist() == ticks and found.corners.ids.tolist() == [3, 8, 3, 8]


def test_names_that_only_count_need_a_rate(tmp_path):
    cv2.imwrite(str(tmp_path / "frame_10.png"), GREY)
    with pytest.raises(InputError, match="rate_hz"):
        pictures_of_folder(tmp_path, "*.png", None)
    with pytest.raises(InputError, match="no file fits"):
        pictures_of_folder(tmp_path, "*.jpg", None)


def test_what_was_looked_for_is_not_looked_for_again(tmp_path, cache, monkeypatch):
    """Broken off in the middle, gone on with; another way of looking, or other images, begin anew."""
    monkeypatch.setattr(looked, "PART", 2)
    (tmp_path / "images").mkdir()
    for k in range(5):
        cv2.imwrite(str(tmp_path / "images" / f"{k}.png"), np.roll(GREY, k, 1))
    calls = []

    def look(looking=None, stop_at=99):
        def progress(stage, done, of):
            calls.append((done, of))
            if done == stop_at:
                raise KeyboardInterrupt

        with mock.patch.object(
            detect.Detector, "__call__", autospec=True, side_effect=detect.Detector.__call__
        ) as counted:
            try:
                return tags_in(
                    pictures_of_folder(tmp_path / "images", "*.png", 1.0), looking or Looking(), progress
                ), counted
            except KeyboardInterrupt:
                return None, counted

    assert look(stop_at=3)[0] is None
    assert len(list(cache.rglob("*.npz"))) == 1 and not list(cache.rglob("*.part"))
    whole, counted = look()
    assert counted.call_count == 3 and calls[-1] == (5, 5)
    again, counted = look()
    assert counted.call_count == 0
    for field in ("frames", "frame", "ids", "corners", "hamming", "widths"):
        assert np.array_equal(getattr(again.corners, field), getattr(whole.corners, field))
    assert again.corners.families == whole.corners.families and again.size == whole.size
    assert look(Looking(("tag25h9",)))[1].call_count == 5
    first = sorted(cache.rglob("000000.npz"))
    for path in first:
        path.write_bytes(path.read_bytes()[:50])  # a disk that lost something
    assert look()[1].call_count == 2
    cv2.imwrite(str(tmp_path / "images" / "4.png"), GREY)
    assert look()[1].call_count == 5


def test_a_team_with_images(tmp_path):
    """A camera carried by hand past two tags, as a folder and as a topic: the same log, but for its words."""
    (tmp_path / "walk").mkdir()
    messages = []
    for k in range(4):
        tags = {3: square((60 + 2 * k, 50), 60, 0.1, 0.1), 8: square((125 + 2 * k, 55), 50, -0.1)}
        image = picture(tags, (170, 110), blur=0.5)
        cv2.imwrite(str(tmp_path / "walk" / f"{k}.png"), image)
        messages.append(recordings.image("/image", 10**9 + k * 10**8, image))
    recordings.write(tmp_path, "bag", messages)
    (tmp_path / "camera.json").write_text(
        '{"camera_matrix": [150, 0, 84.5, 0, 150, 54.5, 0, 0, 1], "image_width": 170, "image_height": 110}'
    )
    logs = []
    for recording, images in (("walk", 'images = "*.png"\nrate_hz = 10.0'), ("recording.bag", 'images = "/image"')):
        (tmp_path / "team.toml").write_text(
            f'[tags]\nsize_m = 0.1\n[[robot]]\nname = "hand"\nrecording = "{recording}"\nimage_every_s = 0.0\n'
            f'[[robot.camera]]\nname = "front"\n{images}\ncalibration = "camera.json"\n'
        )
        logs.append(ts.read(tmp_path / "team.toml"))
        (table,) = (t for t in logs[-1].tables if t.model == "corners")
        assert len(table) == 8 and "8 sightings of tag36h11 in 4 images" in " ".join(logs[-1].notes)
    one, other = (next(t for t in log.tables if t.model == "corners") for log in logs)
    assert np.allclose(one.values, other.values) and np.allclose(one.whitening, other.whitening)


def test_images_of_another_size_than_calibrated_are_refused(tmp_path):
    recordings.write(tmp_path, "bag", [recordings.image("/image", 10**9, GREY)])
    (tmp_path / "camera.json").write_text(
        '{"camera_matrix": [150, 0, 84.5, 0, 150, 54.5, 0, 0, 1], "image_width": 640, "image_height": 480}'
    )
    (tmp_path / "team.toml").write_text(
        '[tags]\nsize_m = 0.1\n[[robot]]\nname = "hand"\nrecording = "recording.bag"\n'
        '[[robot.camera]]\nname = "front"\nimages = "/image"\ncalibration = "camera.json"\n'
    )
    with pytest.raises(InputError, match="170 x 110 pixels, and its calibration is for 640 x 480"):
        ts.read(tmp_path / "team.toml")
