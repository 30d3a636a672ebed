"""Recordings in which something is odd: what is wrong with them is said in a true sentence, and what is left out is
counted."""

import cv2
import numpy as np
import pytest

import recordings
import teamslam as ts
from tag_pictures import picture, square
from teamslam.errors import InputError

START = 1_700_000_000 * 10**9
COUNT = 6
TAGS = {3: square((50, 50), 60, 0.2), 8: square((120.5, 60.3), 50, -1.0)}
IMAGE = picture(TAGS, (170, 110), blur=0.5)
CAMERA = (
    '{"camera_matrix": [150, 0, 85, 0, 150, 55, 0, 0, 1], "distortion_coefficients": [0, 0, 0, 0], '
    '"image_width": 170, "image_height": 110}'
)
TEAM = """
[tags]
size_m = 0.16
{tags}
[[robot]]
name = "one"
recording = "recording"
odometry = "/odom"
dim = 2
image_every_s = 0.0
[[robot.camera]]
name = "front"
{seen}
calibration = "camera.json"
xyz_m = [0.0, 0.0, 0.0]
quaternion_wxyz = [0.5, -0.5, 0.5, -0.5]
"""


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def stamps():
    return [START + k * 10**8 for k in range(COUNT)]


def driven(stamped=lambda stamp: stamp):
    """Odometry, recorded when it was made and stamped otherwise."""
    return [
        recordings.odometry("/odom", stamped(at), (0.02 * k, 0, 0), received_ns=at) for k, at in enumerate(stamps())
    ]


def detected(tags=TAGS, late_ns=0):
    return [
        recordings.detections("/tags", at + late_ns, [(n, c + 0.5) for n, c in tags.items()], at) for at in stamps()
    ]


def team(folder, messages, seen='tags = "/tags"', tags="", more=""):
    """A team file of one robot with such a recording."""
    recordings.write(folder, "mcap", messages)
    (folder / "camera.json").write_text(CAMERA)
    (folder / "team.toml").write_text(TEAM.format(seen=seen, tags=tags) + more)
    return folder / "team.toml"


def counted(log):
    return {drop.reason: drop.count for drop in log.dropped}


@pytest.mark.parametrize("late_s", [3600, -3600])
def test_sightings_that_are_stamped_an_hour_beside_odometry(late_s, tmp_path):
    log = ts.read(team(tmp_path, [*driven(), *detected(late_ns=late_s * 10**9)]))
    (note,) = [note for note in log.notes if "odometry" in note]
    assert "1700000000.0 s to 1700000000.5 s" in note and f"{1700000000 + late_s}.0 s to" in note
    assert "different clocks" in note


def test_odometry_that_is_in_time_is_not_said_to_be_out_of_it(tmp_path):
    log = ts.read(team(tmp_path, [*driven(), *detected()]))
    assert not any("clocks" in note or "headers" in note for note in log.notes) and not log.dropped


def test_odometry_without_stamps_is_told(tmp_path):
    log = ts.read(team(tmp_path, [*driven(lambda at: 0), *detected()]))
    (note,) = [note for note in log.notes if "/odom" in note]
    assert "no time in their headers" in note
    (steps,) = [table for table in log.tables if table.source == "odometry"]
    np.testing.assert_allclose(steps.values[:, 0], 0.02, atol=1e-9)  # by when they were recorded


def test_numbers_below_0_are_no_tags(tmp_path):
    tags = {**TAGS, -5: square((30, 90), 20)}
    log = ts.read(team(tmp_path, [*driven(), *detected(tags)]))
    assert counted(log) == {"robot one: messages of /tags: a tag with a number below 0": COUNT}
    assert len(log.landmark_keys) == len(TAGS)


def test_a_robot_that_sees_its_own_tag(tmp_path):
    own = "[[robot.tag]]\nnumber = 3\nxyz_m = [0.5, 0.0, 0.0]\nrotation_vector = [0.0, 0.0, 0.0]\n"
    log = ts.read(team(tmp_path, [*driven(), *detected()], more=own))
    assert counted(log) == {"robot one, camera front: sightings of tags that it carries itself": COUNT}


def test_a_landmark_of_which_nobody_saw_a_tag(tmp_path):
    box = '[[landmark]]\nname = "box"\n[[landmark.tag]]\nnumber = 55\n'
    notes = ts.read(team(tmp_path, [*driven(), *detected()], more=box)).notes
    assert "landmark box: nobody saw a tag of it (55)" in notes
    (tmp_path / "team.toml").write_text((tmp_path / "team.toml").read_text().replace("55", "8"))
    assert not any("nobody" in note for note in ts.read(tmp_path / "team.toml").notes)


@pytest.mark.parametrize(
    ("tags", "words"),
    [("fewest = 100", f"{COUNT}: robot one: sightings of tag 3, seen in fewer than 100 images"),
     ("ignore = [3, 8]", f"{2 * COUNT}: robot one, camera front: sightings of tags that the team file ignores")],
)  # fmt: skip
def test_where_every_sighting_was_left_out_it_is_said_why(tags, words, tmp_path):
    with pytest.raises(InputError) as error:
        ts.read(team(tmp_path, [*driven(), *detected()], tags=tags))
    assert "no sighting of a tag is left. Left out were" in str(error.value) and words in str(error.value)


def test_a_family_that_is_not_there_is_named(tmp_path):
    blank = np.full((110, 170), 120, np.uint8)
    images = [recordings.image("/raw", at, blank) for at in stamps()]
    with pytest.raises(InputError, match=r"no tag was seen in any image \(families: tag25h9\); check topics, families"):
        ts.read(team(tmp_path, [*driven(), *images], 'images = "/raw"', 'families = ["tag25h9"]'))


def test_depths_that_are_taken_for_images_are_told(tmp_path):
    depth = b"\0" * 12 + cv2.imencode(".png", np.full((110, 170), 2500, np.uint16))[1].tobytes()
    name = "/depth/compressedDepth"
    images = [recordings.compressed(name, at, depth, "16UC1; compressedDepth png") for at in stamps()]
    with pytest.raises(InputError, match=f"{COUNT}: robot one, camera front: images that cannot be decompressed"):
        ts.read(team(tmp_path, [*driven(), *images], f'images = "{name}"'))


def test_images_by_themselves_are_told_where_they_go(tmp_path):
    (tmp_path / "walk").mkdir()
    for at in stamps():
        cv2.imwrite(str(tmp_path / "walk" / f"{at}.png"), IMAGE)
    with pytest.raises(InputError, match=r"holds images .*recording = 'walk', .*images = '\*\.png'"):
        ts.read(tmp_path / "walk")
    film = cv2.VideoWriter(str(tmp_path / "walk.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 10.0, (170, 110), False)
    film.write(IMAGE)
    film.release()
    with pytest.raises(InputError, match=r"is a video; .*recording = 'walk\.avi', .*images = '\*'"):
        ts.read(tmp_path / "walk.avi")


def test_odometry_in_millimetres_is_a_way_that_jumps_all_along(tmp_path):
    """It says nothing, and a map is made without it."""
    stamps = [START + k * 10**8 for k in range(60)]
    messages = [recordings.odometry("/odom", at, (2000.0 * k, 0, 0)) for k, at in enumerate(stamps)]
    messages += [recordings.detections("/tags", at, [(n, c + 0.5) for n, c in TAGS.items()]) for at in stamps]
    log = ts.read(team(tmp_path, messages))
    assert any("jumped 59 times" in note for note in log.notes)
    assert len(ts.run(log).landmarks) == len(TAGS)


def test_corners_that_enclose_nothing_are_no_tag(tmp_path):
    point = np.tile([[40.0, 80.0]], (4, 1))
    log = ts.read(team(tmp_path, [*driven(), *detected({**TAGS, 9: point})]))
    assert counted(log) == {"robot one: messages of /tags: a tag whose corners enclose nothing": COUNT}


def test_corners_that_go_round_the_wrong_way_are_told(tmp_path):
    log = ts.read(team(tmp_path, [*driven(), *detected({3: TAGS[3][::-1], 8: TAGS[8]})]))
    (note,) = [note for note in log.notes if "wrong way" in note]
    assert note.startswith(f"robot one, camera front: the corners of {COUNT} of {2 * COUNT} sightings")


def test_images_with_one_stamp_are_told(tmp_path):
    seen = [recordings.detections("/tags", START, [(3, TAGS[3] + 0.5)], START + k) for k in range(3)]
    log = ts.read(team(tmp_path, [*driven(), *seen, *detected()]))
    assert f"robot one, camera front: 3 of {COUNT + 3} images have the stamp of another" in log.notes


@pytest.mark.parametrize("old", ['name = "one"', 'name = "box"'])
def test_a_name_that_is_empty_is_refused(old, tmp_path):
    box = '[[landmark]]\nname = "box"\n[[landmark.tag]]\nnumber = 8\n'
    path = team(tmp_path, [*driven(), *detected()], more=box)
    path.write_text(path.read_text().replace(old, 'name = " "'))
    with pytest.raises(InputError, match=r"a (robot|landmark) has a name"):
        ts.read(path)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [("image_every_s = 0.0", "image_every_s = nan", r"'robot\[0\].image_every_s'.*number, found nan"),
     ("image_every_s = 0.0", "image_every_s = inf", r"'robot\[0\].image_every_s'.*number, found inf"),
     ("xyz_m = [0.0", "xyz_m = [nan", r"'robot\[0\].camera\[0\].xyz_m\[0\]'.*number, found nan"),
     ("dim = 2", "dim = 2\nmotion = { speed_m_s = -1.0 }", "'robot.motion'.*speeds of robot one are above 0"),
     ("dim = 2", "dim = 2\nmotion = { slip_m = -1.0 }", "'robot.motion'.*0 or more"),
     ("dim = 2", "dim = 2\nmotion = { slip_m = 0.0, drift_m = 0.0 }", "'robot.motion'.*odometry errs"),
     ("size_m = 0.16", "size_m = 0.16\nsizes_m = { seven = 0.3 }", "'tags.sizes_m'.*found 'seven'")],
)  # fmt: skip
def test_what_can_be_no_number_is_refused_by_its_field(old, new, words, tmp_path):
    path = team(tmp_path, [*driven(), *detected()])
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(InputError, match=words):
        ts.read(path)


def test_a_speed_that_nothing_exceeds_is_one(tmp_path):
    path = team(tmp_path, [*driven(), *detected()])
    path.write_text(path.read_text().replace("dim = 2", "dim = 2\nmotion = { fastest_m_s = inf }"))
    assert not ts.read(path).dropped
