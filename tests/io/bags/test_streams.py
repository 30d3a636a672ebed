"""What was written is what is read, of every kind of recording; stamps are those of headers; what is odd is counted."""

import numpy as np
import pytest

import recordings
from teamslam.errors import InputError
from teamslam.io.bags import contents, opened, read_corners, read_track, read_transforms

START = 1_700_000_000 * 10**9
STEP = 10**8


@pytest.fixture(params=recordings.KINDS)
def kind(request):
    return request.param


def drive(count=20):
    """Odometry that comes 30 ms late and every 0.1 s, with one message missing; tags in every other image."""
    rng = np.random.default_rng(0)
    turns = rng.normal(size=(count, 4))
    turns *= rng.uniform(0.8, 1.2, (count, 1)) / np.linalg.norm(turns, axis=1, keepdims=True)
    places = rng.normal(size=(count, 3))
    corners = rng.uniform(0, 640, (count, 4, 2))
    messages = []
    for k in range(count):
        stamp = START + k * STEP
        if k != 7:
            messages.append(recordings.odometry("/odom", stamp, places[k], turns[k], stamp + 30_000_000))
        tags = [(k, corners[k]), (100 + k, corners[k] + 1)] if k % 2 else []
        messages.append(recordings.detections("/camera/tags", stamp + 5000, tags, stamp + 40_000_000))
    return messages, turns, places, corners


def test_odometry_comes_back_with_the_stamps_of_its_headers(tmp_path, kind):
    messages, turns, places, _ = drive()
    with opened(recordings.write(tmp_path, kind, messages)) as recording:
        track = read_track(recording, "/odom")
    there = np.arange(20) != 7
    assert track.ticks.tolist() == [(START + k * STEP) // 1000 for k in np.flatnonzero(there)]
    np.testing.assert_allclose(track.poses.translation, places[there])
    unit = turns / np.linalg.norm(turns, axis=1, keepdims=True)
    # R(q) v by the quaternion product, written out: v + 2 w (u x v) + 2 u x (u x v).
    u, w, v = unit[there, :3], unit[there, 3:], np.array([0.3, -1.0, 2.0])
    turned = v + 2 * w * np.cross(u, v) + 2 * np.cross(u, np.cross(u, v))
    np.testing.assert_allclose(track.poses.rotation @ v, turned, atol=1e-12)
    np.testing.assert_array_equal(track.covariances[3].ravel(), np.arange(36.0))
    assert (track.parent, track.child) == ("odom", "base")
    assert not recording.dropped


def test_corners_come_back_with_pixel_centres_at_whole_numbers(tmp_path, kind):
    messages, _, _, corners = drive()
    with opened(recordings.write(tmp_path, kind, messages)) as recording:
        found = read_corners(recording, "/camera/tags")
    assert len(found.frames) == 20 and len(found) == 20
    assert found.ids.tolist() == [n for k in range(1, 20, 2) for n in (k, 100 + k)]
    assert found.ticks.tolist() == [(START + k * STEP + 5000) // 1000 for k in range(1, 20, 2) for _ in range(2)]
    np.testing.assert_allclose(found.corners[::2], corners[1::2] - 0.5)
    assert set(found.families) == {"tag36h11"}


def test_transforms_come_as_a_track_for_each_pair_of_frames(tmp_path, kind):
    type = "tf/msg/tfMessage" if kind == "bag" else "tf2_msgs/msg/TFMessage"
    messages = [recordings.transform("/tf_static", START, "base", "camera", (0.1, 0.0, 0.2), type)]
    messages += [recordings.transform("/tf", START + k * STEP, "odom", "base", (k, 0.0, 0.0), type) for k in range(3)]
    with opened(recordings.write(tmp_path, kind, messages)) as recording:
        tracks = {(t.parent, t.child): t for t in read_transforms(recording)}
    assert set(tracks) == {("base", "camera"), ("odom", "base")}
    np.testing.assert_allclose(tracks["odom", "base"].poses.translation[:, 0], [0, 1, 2])


def test_contents_tell_rates_and_gaps(tmp_path, kind):
    messages, *_ = drive(60)
    messages = [m for m in messages if not (m[0] == "/odom" and 20 * STEP <= m[2] - START < 30 * STEP)]
    found = contents(recordings.write(tmp_path, kind, messages))
    odometry, tags = (next(t for t in found.topics if t.name == name) for name in ("/odom", "/camera/tags"))
    assert (odometry.role, tags.role) == ("odometry", "tags")
    assert (len(odometry.stamps_s), len(tags.stamps_s)) == (60 - 1 - 10, 60)
    np.testing.assert_allclose(odometry.rate_hz, 10.0, rtol=1e-6)
    np.testing.assert_allclose(odometry.gaps_s, [1.1], rtol=1e-6)  # one message missing is no gap
    assert not len(tags.gaps_s) and not tags.steps_back


def test_a_stamp_that_steps_back_is_seen(tmp_path, kind):
    late = [recordings.odometry("/odom", START + s * STEP, (0, 0, 0), received_ns=START + k * STEP)
            for k, s in enumerate([0, 1, 2, 1, 4])]  # fmt: skip
    found = contents(recordings.write(tmp_path, kind, late))
    assert found.topics[0].steps_back == 1


def test_poses_that_are_none_are_counted(tmp_path, kind):
    good = recordings.odometry("/odom", START, (1, 2, 3))
    lost = recordings.odometry("/odom", START + STEP, (np.nan, 0, 0))
    still = recordings.odometry("/odom", START + 2 * STEP, (0, 0, 0), (0, 0, 0, 0))
    with opened(recordings.write(tmp_path, kind, [good, lost, still])) as recording:
        track = read_track(recording, "/odom")
    assert len(track) == 1
    assert [d.count for d in recording.dropped] == [2]


def test_a_stamp_of_zero_is_the_time_of_receipt(tmp_path, kind):
    path = recordings.write(tmp_path, kind, [recordings.odometry("/odom", 0, (1, 2, 3), received_ns=START)])
    with opened(path) as recording:
        assert read_track(recording, "/odom").ticks.tolist() == [START // 1000]


def test_a_topic_that_is_not_there_or_holds_something_else_is_named(tmp_path, kind):
    messages, *_ = drive(3)
    with opened(recordings.write(tmp_path, kind, messages)) as recording:
        with pytest.raises(InputError, match=r"no topic /odometry; this recording has /camera/tags, /odom"):
            read_track(recording, "/odometry")
        with pytest.raises(InputError, match="/odom holds nav_msgs/msg/Odometry; expected one of apriltag_msgs"):
            read_corners(recording, "/odom")


def test_the_tags_of_a_real_recording(data):
    """test_10 of TagSLAM: 3,579 images, 81 ids (the data's own description)."""
    bag = data("tagslam_dupont") / "test_10" / "tag_detections.bag"
    with opened(bag) as recording:
        found = read_corners(recording, "/pg_17274483/tags")
    assert len(found.frames) == 3579
    assert len(np.unique(found.ids)) == 81
    several = np.bincount(found.frame, minlength=3579) > 1
    assert several.sum() == 798
