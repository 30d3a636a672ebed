"""`teamslam run BAG... --config team.toml --out DIR`: recordings and the team file that says what they are."""

import numpy as np
import pytest

import recordings
import tagged_room
import teamslam as ts
from tag_pictures import picture, square


@pytest.fixture(scope="module")
def team(tmp_path_factory):
    return tagged_room.write(tagged_room.make(seconds=12.0, rate=2.0), tmp_path_factory.mktemp("team"), "bag")


def run(teamslam, out, *arguments):
    return teamslam("run", *arguments, "--out", out, "--no-figures")


def test_recordings_stand_for_those_of_the_team_file_in_their_order(team, teamslam, tmp_path, monkeypatch):
    moved = [tmp_path / f"day{k}.bag" for k in (0, 1)]
    for robot, path in enumerate(moved):
        path.symlink_to(team.parent / f"robot{robot}" / "recording.bag")
    monkeypatch.chdir(tmp_path)
    usual = run(teamslam, tmp_path / "usual", team)
    called = run(teamslam, tmp_path / "map", *(path.name for path in moved), "--config", team)
    assert called.code == usual.code in (0, 3), called.err
    one, other = (ts.read_run(tmp_path / name).trajectory("robot0") for name in ("usual", "map"))
    np.testing.assert_array_equal(one.poses.translation, other.poses.translation)
    again = run(teamslam, tmp_path / "again", team, "--config", tmp_path / "map" / "config.toml")
    assert again.code == called.code
    swapped = run(teamslam, tmp_path / "swapped", *reversed(moved), "--config", team)
    assert swapped.code != 2
    theirs = ts.read_run(tmp_path / "swapped").trajectory("robot0")
    assert not np.array_equal(theirs.poses.translation, one.poses.translation)


def test_a_call_that_says_too_little_is_told_what_to_say(team, teamslam, tmp_path):
    bag = team.parent / "robot0" / "recording.bag"
    for arguments, words in (
        ((bag, "--config", team), "the team file names 2 recordings"),
        ((bag, bag), "2 inputs, and one log makes a map; recordings of a team go with --config"),
        ((), "no log"),
    ):
        called = run(teamslam, tmp_path / "map", *arguments)
        assert called.code == 2 and words in called.err
        assert not (tmp_path / "map").exists()


def test_a_team_file_holds_options_of_the_run(team, teamslam, tmp_path):
    text = team.read_text().replace('recording = "', f'recording = "{team.parent}/')
    text = text.replace('"camera.json"', f'"{team.parent}/camera.json"')
    path = tmp_path / "team.toml"
    path.write_text(text + '[options]\nmethod = "full"\n')
    for arguments in ((path,), ("--config", path)):
        assert run(teamslam, tmp_path / "map", *arguments, "--force").code in (0, 3)
        assert 'method = "full"' in (tmp_path / "map" / "config.toml").read_text()
    path.write_text(text + "[options.join]\nexakt = true\n")
    called = run(teamslam, tmp_path / "other", path)
    assert called.code == 2 and "exakt" in called.err and "exact" in called.err


def test_a_rig_as_info_proposes_it_runs(teamslam, tmp_path, monkeypatch):
    """Nobody said yet where its cameras are, so both are at one place; each has corners and figures of its own."""
    pytest.importorskip("cv2")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    messages = []
    for k in range(5):
        stamp = 10**18 + k * 200_000_000
        for name, tags in (("left", (3, 8)), ("right", (8, 5, 3))):
            shown = {tag: square((50 + 70 * n + k, 60), 50, 0.1 * n) for n, tag in enumerate(tags)}
            messages.append(recordings.image(f"/{name}/image_raw", stamp, picture(shown, (240, 120), blur=0.5)))
            calibration = f"/{name}/camera_info"
            messages.append(recordings.camera_info(calibration, stamp, (200.0, 200.0), (119.5, 59.5), (240, 120)))
    path = recordings.write(tmp_path, "mcap", messages)
    told = teamslam("info", path).out
    (tmp_path / "team.toml").write_text(told[told.index("[tags]") :])
    called = teamslam("run", tmp_path / "team.toml", "--out", tmp_path / "map")
    assert called.code in (0, 1, 3), called.err
    rows = (tmp_path / "map" / "tags" / "reprojection.csv").read_text().splitlines()[1:]
    assert [row.split(",")[1:4] for row in rows] == [
        *(["left", tag, "5"] for tag in "38"),
        *(["right", tag, "5"] for tag in "358"),
    ]
    assert (tmp_path / "map" / "figures" / "figure_5.png").is_file()
