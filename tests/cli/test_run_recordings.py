"""`teamslam run BAG... --config team.toml --out DIR`: recordings and the team file that says what they are."""

import numpy as np
import pytest

import tagged_room
import teamslam as ts


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
