"""Videos and folders with lists of stamps are recordings of a robot; damage is told."""

import numpy as np
import pytest

import teamslam as ts
from tag_pictures import picture, square
from teamslam.errors import InputError
from teamslam.frontend.tags.detect import Looking
from teamslam.io.bags.image_stamps import read_stamps
from teamslam.io.bags.looked import tags_in
from teamslam.io.bags.pictures import pictures_of_folder
from teamslam.io.bags.videos import pictures_of_video, write_video

cv2 = pytest.importorskip("cv2")
IMAGES = [picture({3: square((60 + 4 * k, 60), 60, 0.1)}, (170, 120), blur=0.5) for k in range(5)]


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


@pytest.fixture
def video(tmp_path):
    write_video(tmp_path / "walk.avi", IMAGES, 4.0)
    return tmp_path / "walk.avi"


def test_a_video_has_the_stamps_of_its_container(video):
    found = tags_in(pictures_of_video(video), Looking())
    assert found.corners.frames.tolist() == [250_000 * k for k in range(5)] and found.size == (170, 120)
    assert found.corners.ids.tolist() == [3] * 5
    assert np.allclose(np.diff(found.corners.corners.mean(1), axis=0), [4.0, 0.0], atol=0.3)


def test_other_stamps_are_other_stamps_although_the_images_are_known(video, tmp_path):
    tags_in(pictures_of_video(video), Looking())
    faster = tags_in(pictures_of_video(video, rate_hz=10.0), Looking())
    assert faster.corners.frames.tolist() == [100_000 * k for k in range(5)]
    (tmp_path / "stamps.txt").write_text("stamp\n" + "\n".join(str(10.5 + k) for k in range(5)))
    names, ticks = read_stamps(tmp_path / "stamps.txt")
    assert not any(names)
    found = tags_in(pictures_of_video(video, stamps=ticks), Looking())
    assert found.corners.frames.tolist() == [10_500_000 + 1_000_000 * k for k in range(5)]


@pytest.mark.parametrize(
    "text",
    [
        "#timestamp [ns],filename\n1403636579763555584,b.png\n1403636579813555456,a.png\n",
        "# rgb\n1403636579.763555584 rgb/b.png\n1403636579.813555456 rgb/a.png\n",
        "file;stamp\nb.png;1403636579.763555584\na.png;1403636579.813555456\n",
    ],
)
def test_a_folder_by_a_list_of_stamps(text, tmp_path):
    for name, image in (("a.png", IMAGES[0]), ("b.png", IMAGES[1])):
        cv2.imwrite(str(tmp_path / name), image)
    (tmp_path / "data.csv").write_text(text)
    found = pictures_of_folder(tmp_path, "*.png", None, read_stamps(tmp_path / "data.csv"))
    ticks = [image.tick for image in found.each()]
    assert ticks[1] - ticks[0] in (49999, 50000) and abs(ticks[0] - 1403636579763555) < 2
    assert np.array_equal(next(found.each()).grey(), IMAGES[1])
    cv2.imwrite(str(tmp_path / "c.png"), IMAGES[2])
    with pytest.raises(InputError, match=r"has none of this image"):
        pictures_of_folder(tmp_path, "*.png", None, read_stamps(tmp_path / "data.csv"))


@pytest.mark.parametrize(
    ("text", "words"),
    [("", "no stamps in it"), ("a\nb\n", "no stamps in it"), ("1.0\n0.5\n", "line 2.*not after the one before"),
     ("1.0\nx.png\n", "line 2.*no stamp in 'x.png'")],
)  # fmt: skip
def test_lists_that_are_none(text, words, tmp_path):
    (tmp_path / "stamps.csv").write_text(text)
    with pytest.raises(InputError, match=words):
        read_stamps(tmp_path / "stamps.csv")


def test_a_list_for_another_video_is_refused(video):
    with pytest.raises(InputError, match="has 5 images, and there are 9 stamps"):
        pictures_of_video(video, stamps=np.arange(9))


@pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.7, 0.999])
def test_a_video_that_is_cut_short_is_refused_or_ends_early(share, video):
    data = video.read_bytes()
    video.write_bytes(data[: int(share * len(data))])
    try:
        found = tags_in(pictures_of_video(video), Looking())
    except InputError as error:
        assert str(video) in str(error)
    else:
        assert 0 < len(found.corners.frames) <= 5


def test_a_video_is_a_robot(video, tmp_path):
    (tmp_path / "camera.json").write_text(
        '{"camera_matrix": [200, 0, 85, 0, 200, 60, 0, 0, 1], "distortion_coefficients": [0, 0, 0, 0, 0], '
        '"image_width": 170, "image_height": 120}'
    )
    (tmp_path / "team.toml").write_text("""[tags]
size_m = 0.2
[[robot]]
name = "hand"
recording = "walk.avi"
image_every_s = 0.0
[[robot.camera]]
name = "front"
images = "*"
calibration = "camera.json"
""")
    log = ts.read(tmp_path / "team.toml")
    assert any("5 sightings of tag36h11 in 5 images" in note for note in log.notes) and len(log.pose_keys[1]) == 5
    (tmp_path / "camera.json").write_text((tmp_path / "camera.json").read_text().replace("170", "640"))
    with pytest.raises(InputError, match="images are 170 x 120 pixels, and its calibration is for 640 x 120"):
        ts.read(tmp_path / "team.toml")
