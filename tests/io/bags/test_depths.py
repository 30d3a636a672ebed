"""Images of depth beside those in which tags are seen: every encoding says the same; what cannot be used is counted."""

import struct

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import recordings
import teamslam as ts
from teamslam.errors import InputError
from teamslam.inspection import inspect
from teamslam.io.bags import contents, proposal
from teamslam.io.bags.team_file import read_team_file

FOCAL, WIDTH, HEIGHT, SIZE = 300.0, 160, 120, 0.2
CENTRE = np.array([79.5, 59.5])
STAMPS = [10**9 * k for k in range(1, 7)]
TOPIC = "/camera/depth_registered/image_raw"


def plane(k):
    """The tag's plane m . P = 1 in image k: some 1.5 m ahead, leaned."""
    return np.array([0.05 * k - 0.15, 0.1, 1.0]) / (1.5 + 0.1 * k)


def depths(k):
    """Depths [m] of a wall that fills image k."""
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    z = 1.0 / (np.stack([(u - CENTRE[0]) / FOCAL, (v - CENTRE[1]) / FOCAL, np.ones(u.shape)], -1) @ plane(k))
    return z + 2e-3 * np.random.default_rng(k).normal(size=z.shape)


def corners(k):
    """A tag in the plane, about the middle of the image, as detectors count pixels."""
    n = -plane(k) / np.linalg.norm(plane(k))
    x = np.cross([0.0, -1.0, 0.0], n)
    x /= np.linalg.norm(x)
    y = np.cross(n, x)
    centre = np.array([0.0, 0.0, 1.0 / plane(k)[2]])
    places = centre + 0.5 * SIZE * np.array([-x - y, x - y, x + y, -x + y])
    return FOCAL * places[:, :2] / places[:, 2:] + CENTRE + 0.5


def millimetres(k, topic=TOPIC, stamp=None):
    whole = np.round(1e3 * depths(k)).astype("<u2")
    return recordings.image(topic, stamp or STAMPS[k], whole, "16UC1")


def metres(k):
    return recordings.image(TOPIC, STAMPS[k], depths(k).astype("<f4"), "32FC1")


def packed(k):
    data = (
        struct.pack("<iff", 0, 0.0, 0.0)
        + cv2.imencode(".png", np.round(1e3 * depths(k)).astype(np.uint16))[1].tobytes()
    )
    return recordings.compressed(TOPIC, STAMPS[k], data, "16UC1; compressedDepth png")


def packed_metres(k):
    a, b = 100.0 * 101.0, 1.0 - 100.0 * 101.0 / 10.0  # as compressed_depth_image_transport takes them
    whole = np.round(a / depths(k) + b).astype(np.uint16)
    data = struct.pack("<iff", 0, a, b) + cv2.imencode(".png", whole)[1].tobytes()
    return recordings.compressed(TOPIC, STAMPS[k], data, "32FC1; compressedDepth png")


def team_of(folder, messages, kind="mcap", depth=TOPIC):
    """A camera that sees one tag, and what else there is; the path of its team file."""
    seen = [recordings.detections("/camera/tags", stamp, [(3, corners(k))]) for k, stamp in enumerate(STAMPS)]
    way = [recordings.odometry("/odom", stamp, (0.0, 0.0, 0.0)) for stamp in (STAMPS[0] - 10**8, *STAMPS)]
    everything = sorted([*seen, *way, *messages], key=lambda message: message[2])
    path = recordings.write(folder, kind, everything)
    (folder / "camera.json").write_text(
        f'{{"camera_matrix": [{FOCAL}, 0, {CENTRE[0]}, 0, {FOCAL}, {CENTRE[1]}, 0, 0, 1], '
        f'"distortion_coefficients": [], "image_width": {WIDTH}, "image_height": {HEIGHT}}}'
    )
    (folder / "team.toml").write_text(f"""
[tags]
size_m = {SIZE}
[[robot]]
name = "one"
recording = "{path.name}"
odometry = "/odom"
[[robot.camera]]
name = "front"
tags = "/camera/tags"
depth = "{depth}"
calibration = "camera.json"
""")
    return folder / "team.toml"


def rows(log):
    (table,) = [table for table in log.tables if table.source == "landmarks_depth"]
    return table


@pytest.mark.parametrize("kind", ["bag", "mcap"])
@pytest.mark.parametrize("written", [millimetres, metres, packed, packed_metres])
def test_every_encoding_says_in_which_plane_a_tag_is(written, kind, tmp_path):
    log = ts.read(team_of(tmp_path, [written(k) for k in range(6)], kind))
    table = rows(log)
    assert len(table) == 6 and (table.ranks == 3).all() and table.model == "relative_pose"
    for k, z in enumerate(table.values):  # in axes that look along x
        normal, place = z[3:].reshape(3, 3)[:, 2], z[:3]
        m = normal / (normal @ place)
        np.testing.assert_allclose([-m[1], -m[2], m[0]], plane(k), atol=6e-3)
    assert "depths of 6 of 6 sightings" in " ".join(log.notes)
    assert {count.source: count.sensor for count in inspect(log).counts} == {
        "odometry": "", "landmarks": "front", "landmarks_depth": "front",
    }  # fmt: skip


def other_size(k):
    return recordings.image(TOPIC, STAMPS[k], np.ones((60, 80), "<u2"), "16UC1")


def no_depths(k):
    return recordings.image(TOPIC, STAMPS[k], np.ones((HEIGHT, WIDTH), np.uint8), "mono8")


def cut_short(k):
    return recordings.image(TOPIC, STAMPS[k], np.ones((HEIGHT // 2, WIDTH), "<u2"), "16UC1", step=4 * WIDTH)


def spoiled(k):
    return recordings.compressed(TOPIC, STAMPS[k], bytes(range(200)), "16UC1; compressedDepth png")


def colours(k):
    return recordings.compressed(TOPIC, STAMPS[k], bytes(range(200)), "jpeg")


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        (other_size, "of depth of 80 x 60 pixels, where the camera has 160 x 120"),
        (no_depths, "of an encoding that holds no depths, 'mono8'"),
        (cut_short, "do not make an image of the size"),
        (spoiled, "that cannot be decompressed"),
        (colours, "that were compressed as 'jpeg'"),
    ],
)
def test_images_of_depth_that_are_none_are_counted(wrong, reason, tmp_path):
    good = millimetres if wrong in (other_size, no_depths, cut_short) else packed
    log = ts.read(team_of(tmp_path, [wrong(k) if k in (2, 4) else good(k) for k in range(6)]))
    (left,) = [left for left in log.dropped if "images of depth" in left.reason]
    assert left.count == 2 and reason in left.reason and len(rows(log)) == 4


def test_depths_that_are_not_registered_are_refused(tmp_path):
    with pytest.raises(
        InputError, match="80 x 60 pixels, and its calibration is for 160 x 120; depth must be registered"
    ):
        ts.read(team_of(tmp_path, [other_size(k) for k in range(6)]))


def test_depths_for_a_camera_of_unknown_size_are_refused(tmp_path):
    path = team_of(tmp_path, [millimetres(k) for k in range(6)])
    camera = path.with_name("camera.json")
    camera.write_text(camera.read_text().partition(', "image_width"')[0] + "}")
    with pytest.raises(InputError, match="needs the size of its images"):
        ts.read(path)


def test_depths_without_an_image_say_nothing(tmp_path):
    """Stamps between images; the log is as without depths, and says so."""
    log = ts.read(team_of(tmp_path, [millimetres(k, stamp=STAMPS[k] + 10**8) for k in range(6)]))
    assert "depths of 0 of 6 sightings" in " ".join(log.notes) and not len(rows(log))
    (left,) = [left for left in log.dropped if "nearest image of depth" in left.reason]
    assert left.count == 6 and "in the median 100.0 ms" in left.reason
    assert sum(len(table) for table in log.tables if table.model == "corners") == 6


DAMAGES = {
    "good": millimetres,
    "packed": packed,
    "size": other_size,
    "encoding": no_depths,
    "short": cut_short,
    "spoiled": spoiled,
    "colours": colours,
    "empty": lambda k: recordings.image(TOPIC, STAMPS[k], np.zeros((0, 8), "<u2"), "16UC1", step=16),
    "holes": lambda k: recordings.image(TOPIC, STAMPS[k], np.zeros((HEIGHT, WIDTH), "<u2"), "16UC1"),
    "no numbers": lambda k: recordings.image(TOPIC, STAMPS[k], np.full((HEIGHT, WIDTH), np.nan, "<f4"), "32FC1"),
    "endless": lambda k: recordings.image(TOPIC, STAMPS[k], np.full((HEIGHT, WIDTH), np.inf, "<f4"), "32FC1"),
    "behind": lambda k: recordings.image(TOPIC, STAMPS[k], np.full((HEIGHT, WIDTH), -1.0, "<f4"), "32FC1"),
}
EMPTY, COUNTED = (
    ("holes", "no numbers", "endless", "behind"),
    ("size", "encoding", "short", "spoiled", "colours", "empty"),
)


def restamped(message, late_ns):
    """A message whose header says that it was made so much later."""
    topic, type_, received, make = message
    return topic, type_, received, lambda store, header: make(store, lambda at, *frame: header(at + late_ns, *frame))


COMPRESSED = "packed", "spoiled", "colours"
RAW = tuple(kind for kind in DAMAGES if kind not in COMPRESSED)  # a topic holds messages of one type


@settings(max_examples=15, deadline=None)
@given(
    kinds=st.sampled_from([RAW, COMPRESSED]).flatmap(
        lambda some: st.lists(st.sampled_from(some), min_size=6, max_size=6)
    ),
    late_ms=st.lists(st.sampled_from([0, 0, 0, 3, -4, 20, 300, -400]), min_size=6, max_size=6),
    recorded=st.sampled_from(["bag", "mcap"]),
)
def test_damaged_depths_leave_corners_as_they_are(kinds, late_ms, recorded, tmp_path_factory):
    """Every sighting has its depth, or it is counted why it has none; or one error says what is wrong with all."""
    messages = [
        restamped(DAMAGES[kind](k), 10**6 * late) for k, (kind, late) in enumerate(zip(kinds, late_ms, strict=True))
    ]
    path = team_of(tmp_path_factory.mktemp("depths"), messages, recorded)
    near = [abs(late) <= 5 for late in late_ms]
    good = [kind in ("good", "packed") for kind in kinds]
    measured = [kind in (*EMPTY, "good", "packed") for kind in kinds]
    sized = [kind in ("size", "empty") for kind in kinds]
    if any(s and n for s, n in zip(sized, near, strict=True)) and not any(
        m and n for m, n in zip(measured, near, strict=True)
    ):
        with pytest.raises(InputError, match="depth must be registered"):
            ts.read(path)
        return
    log = ts.read(path)
    assert sum(len(table) for table in log.tables if table.model == "corners") == 6
    assert len(rows(log)) == sum(g and n for g, n in zip(good, near, strict=True))
    counted = sum(left.count for left in log.dropped if "images of depth" in left.reason)
    assert counted == sum(kind in COUNTED and n for kind, n in zip(kinds, near, strict=True))
    far = sum(left.count for left in log.dropped if "nearest image of depth" in left.reason)
    assert far == sum(not n for n in near)


@pytest.mark.parametrize(("topic", "words"), [("/nowhere", "no topic /nowhere"), ("/odom", "/odom holds nav_msgs")])
def test_a_topic_without_images_is_refused(topic, words, tmp_path):
    with pytest.raises(InputError, match=words):
        ts.read(team_of(tmp_path, [millimetres(0)], depth=topic))


def test_a_share_that_is_none_is_refused(tmp_path):
    path = team_of(tmp_path, [millimetres(0)])
    path.write_text(path.read_text() + "depth_floor = 1.5\n")
    with pytest.raises(InputError, match="depth_floor is a share"):
        read_team_file(path)


def test_info_proposes_the_depths_that_are_registered(tmp_path):
    team_of(tmp_path, [millimetres(0), millimetres(1, "/camera/depth/image_raw")])
    text = proposal(contents(tmp_path / "recording"))
    assert f'depth = "{TOPIC}"' in text and "/camera/depth/image_raw" not in text
