"""The team file: what it may say, what is wrong in it, and which images are used."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import recordings
import tagged_room
import teamslam as ts
from teamslam.errors import InputError, ModelError
from teamslam.geometry import Pose, concatenate
from teamslam.io.bags import contents, proposal
from teamslam.io.bags.recorded import cameras_of
from teamslam.io.bags.seen import SELDOM, chosen_images
from teamslam.io.bags.team_file import is_team_file, read_team_file
from teamslam.model import Kind, Values, index_of, landmark_key, landmark_number, pose_key

DOCS = Path(__file__).parents[3] / "docs" / "recordings.md"


@pytest.fixture(scope="module")
def team(tmp_path_factory):
    return tagged_room.write(tagged_room.make(seconds=24.0, rate=1.5), tmp_path_factory.mktemp("team"), "bag")


def test_the_team_file_of_the_docs_is_one(tmp_path):
    text, folder, *_ = re.findall(r"```toml\n(.*?)```", DOCS.read_text(encoding="utf-8"), re.DOTALL)
    (tmp_path / "team.toml").write_text(f"[tags]\nsize_m = 0.1\n{folder}")
    assert read_team_file(tmp_path / "team.toml").robot[0].camera[0].rate_hz == 30.0
    (tmp_path / "team.toml").write_text(text)
    assert is_team_file(tmp_path / "team.toml")
    found = read_team_file(tmp_path / "team.toml")
    assert found.size_of(7) == 0.30 and found.size_of(8) == 0.15
    assert {tag.carrier for tag in found.carried().values()} == {"one", "box"}


def wrong(team, tmp_path, old, new):
    text = team.read_text().replace('recording = "', f'recording = "{team.parent}/')
    text = text.replace('"camera.json"', f'"{team.parent}/camera.json"')
    assert old in text
    (tmp_path / "team.toml").write_text(text.replace(old, new, 1))
    return tmp_path / "team.toml"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("size_m = 0.14", "size_m = -1.0", "the edge of a tag is above 0"),
        ("size_m = 0.14", "sise_m = 0.14", "sise_m|size_m"),
        ("size_m = 0.14", "size_m = 0.14\nloss = 'none'", "none"),
        ('name = "robot1"', 'name = "robot0"', "two robots are called robot0"),
        ("dim = 2", "dim = 4", "in the plane \\(2\\) or in space \\(3\\), found 4"),
        ('odometry = "/odom"', "", "moves on the ground and needs odometry"),
        ('odometry = "/odom"', 'odometry = "/odometry"', "no topic /odometry; this recording has"),
        ('tags = "/camera/tags"', 'tags = "/odom"', "expected one of apriltag_msgs"),
        (
            'tags = "/camera/tags"',
            'images = "/camera/image"',
            "of images this recording has none",
        ),
        ('tags = "/camera/tags"', 'tags = "/a"\nimages = "/b"', "has both"),
        ('tags = "/camera/tags"', 'images = "/odom"', "/odom holds nav_msgs"),
        ("size_m = 0.14", "size_m = 0.14\nfamilies = ['tag36h12']", "unknown family 'tag36h12'"),
        ("/camera.json", "/camera.yaml", "cannot be read"),
        ("/robot0/", "/robot7/", "no such recording"),
        ("number = 100", "number = 101", "tag 101 is on robot0 and on robot0"),
        ("quaternion_wxyz = [0.5, -0.5, 0.5, -0.5]", "quaternion_wxyz = [0, 0, 0, 0]", "a quaternion has length 1"),
        ("[[robot]]", "[[robot]", "not valid TOML"),
    ],
)
def test_what_is_wrong_is_named(team, tmp_path, old, new, words):
    with pytest.raises((InputError, ModelError), match=words):
        ts.read(wrong(team, tmp_path, old, new))


@pytest.mark.parametrize("kind", recordings.KINDS)
def test_every_kind_of_recording_gives_the_same_log(tmp_path, team, kind):
    room = tagged_room.make(seconds=24.0, rate=1.5)
    other = ts.read(tagged_room.write(room, tmp_path, kind))
    for one, two in zip(ts.read(team).tables, other.tables, strict=True):
        assert (one.source, one.model, one.robot) == (two.source, two.model, two.robot)
        np.testing.assert_array_equal(one.keys, two.keys)
        np.testing.assert_array_equal(one.values, two.values)


def test_rows_of_two_cameras_have_numbers_of_their_own(team, tmp_path):
    text = team.read_text()
    start = text.index("[[robot.camera]]")
    camera = text[start : text.index("[[", start + 5)]
    twice = camera.replace('"camera.json"', f'"{team.parent}/camera.json"')
    path = wrong(team, tmp_path, twice, twice + twice.replace('"front"', '"again"'))
    log = ts.read(path)
    ids = np.concatenate([t.ids for t in log.tables if t.robot == 1 and t.source == "landmarks"])
    assert len(np.unique(ids)) == len(ids) > 0


@given(st.integers(0, 2**32), st.sampled_from([0.0, 0.3, 2.0]))
def test_images_are_chosen_by_what_they_show(seed, every_s):
    rng = np.random.default_rng(seed)
    m = int(rng.integers(0, 200))
    ticks = np.sort(rng.choice(np.arange(60) * 200_000, m))
    ids = rng.integers(0, 12, m)
    chosen = chosen_images(ticks, ids, every_s)
    assert set(chosen.tolist()) <= set(ticks.tolist())
    images = ticks // 200_000
    used = np.isin(images, chosen // 200_000)
    for number in np.unique(ids):
        there = len(np.unique(images[ids == number]))
        assert len(np.unique(images[used & (ids == number)])) >= min(SELDOM, there)
    if every_s == 0.0:
        assert used.all()
    # Of each stretch none that is left out shows more than the best that is used.
    counts = np.bincount(images, minlength=60)
    if m:
        stretch = (np.arange(60) * 200_000 - images[0] * 200_000) // max(int(every_s * 1e6), 1)
        for s in np.unique(stretch[counts > 0]):
            of = (stretch == s) & (counts > 0)
            assert counts[of & np.isin(np.arange(60), chosen // 200_000)].max() == counts[of].max()


def test_tags_seen_too_seldom_or_mended_too_much_are_counted(team, tmp_path):
    path = wrong(team, tmp_path, "size_m = 0.14", "size_m = 0.14\nignore = [0, 1, 2, 3]")
    log = ts.read(path)
    assert sum(d.count for d in log.dropped if "ignores" in d.reason) > 0
    assert not np.isin(
        np.concatenate([t.keys[:, -1] for t in log.tables if t.source == "landmarks"]), [0, 1, 2, 3]
    ).any()
    with pytest.raises(InputError, match="no sighting of a tag is left"):
        ts.read(wrong(team, tmp_path, "size_m = 0.14", "size_m = 0.14\nfewest = 1000"))


def misfit(log, room):
    """The mean square of corners' residuals at the truth, in sigmas."""
    poses, tags = [], []
    for robot, way in enumerate(room.ways, 1):
        poses.append((pose_key(robot, room.ticks_ns // 1000), Pose.from_xytheta(way)))
    for number, (R, T) in room.walls.items():
        tags.append((landmark_key(np.array([landmark_number(str(number))])), Pose(R, T)[None]))
    both = {Kind.POSE2: poses, Kind.POSE3: tags}
    truth = Values.of({k: (np.concatenate([a for a, _ in f]), concatenate([b for _, b in f])) for k, f in both.items()})
    return np.mean(np.concatenate([t.whitened(truth).ravel() for t in log.tables if t.model == "corners"]) ** 2)


def test_what_a_rolling_shutter_moved_is_put_back(tmp_path):
    """Corners, of walls and of robots, each where it was when its line was read: with the line time stated they fit the
    truth to within their noise, and without it they do not."""
    room = tagged_room.make(seconds=20.0, rate=4.0, line_s=30e-6)
    team = tagged_room.write(room, tmp_path, odometry_noise=0.0)
    assert 0.9 < misfit(ts.read(team), room) < 1.2
    (tmp_path / "other").mkdir()
    ignored = wrong(team, tmp_path / "other", "line_s = 3e-05", "line_s = 0.0")
    assert misfit(ts.read(ignored), room) > 3.0
    unsized = re.sub(r'"image_width".*?480', '"x": 0', (tmp_path / "camera.json").read_text())
    (tmp_path / "unsized.json").write_text(unsized)
    with pytest.raises(InputError, match="needs the size of its images"):
        ts.read(wrong(team, tmp_path / "other", f"{tmp_path}/camera.json", f"{tmp_path}/unsized.json"))


def test_a_number_that_is_twice_in_one_image_is_left_out_there_and_counted(tmp_path):
    room = tagged_room.make(0, 20.0, 2.0)
    apart = ts.read(tagged_room.write(room, made(tmp_path / "apart")))
    twins = ts.read(tagged_room.write(replace(room, called={6: 2}), made(tmp_path / "twins")))
    (pose, number) = np.concatenate([t.keys for t in apart.tables if t.source == "landmarks"]).T
    both = np.intersect1d(*(pose[index_of(number) == tag] for tag in (2, 6)))
    drops = [d for d in twins.dropped if "twice in one image" in d.reason]
    assert len(both) and sum(d.count for d in drops) == 2 * len(both) and all(d.reason.endswith(": 2") for d in drops)


def made(folder):
    folder.mkdir()
    return folder


@pytest.mark.parametrize("topic", ["/camera/camera_info", "camera/camera_info", "camera_info"])
def test_a_calibration_is_a_topic_however_it_is_spelt(tmp_path, topic):
    """ROS 1 bags hold topics without a slash at the beginning as well."""
    corners = [[90.0, 140.0], [140.0, 140.0], [140.0, 90.0], [90.0, 90.0]]
    camera = recordings.camera_info(topic, 10**18, (300.0, 310.0), (160.0, 120.0), (320, 240))
    path = recordings.write(tmp_path, "bag", [camera, recordings.detections("tags", 10**18, [(3, corners)])])
    (tmp_path / "team.toml").write_text(proposal(contents(path)).replace("calibration.yaml", topic))
    (robot,) = read_team_file(tmp_path / "team.toml").robot
    (camera,) = cameras_of(robot, tmp_path)
    assert camera.focal == (300.0, 310.0) and camera.size == (320, 240)


def test_rectified_images_are_of_the_matrix_of_rectified_images(tmp_path):
    """A detector that looked at image_rect: K and D of the raw image say nothing of its corners, P does."""
    new = np.array([280.0, 0, 150, 0, 0, 290.0, 110, 0, 0, 0, 1, 0])
    camera = recordings.camera_info(
        "/c/camera_info", 10**18, (300.0, 310.0), (160.0, 120.0), (320, 240), (-0.3, 0.1, 0.0, 0.0, 0.0), matrix=new
    )
    corners = [[90.0, 140.0], [140.0, 140.0], [140.0, 90.0], [90.0, 90.0]]
    path = recordings.write(tmp_path, "mcap", [camera, recordings.detections("/c/tags", 10**18, [(3, corners)])])
    text = proposal(contents(path))
    (tmp_path / "team.toml").write_text(text.replace("# rectified", "rectified"))
    (robot,) = read_team_file(tmp_path / "team.toml").robot
    (camera,) = cameras_of(robot, tmp_path)
    np.testing.assert_allclose(camera.project(np.array([0.1, -0.2, 1.0])), [150 + 28, 110 - 58])
    (tmp_path / "team.toml").write_text(text.replace("# rectified", "rectified").replace("/c/camera_info", "c.yaml"))
    (robot,) = read_team_file(tmp_path / "team.toml").robot
    with pytest.raises(InputError, match="without distortion, and leave `rectified` out"):
        cameras_of(robot, tmp_path)
