"""A tag that is larger or smaller than stated is named, with the size that it has; right ones are not."""

import json
from dataclasses import replace

import numpy as np
import pytest

import tagged_room
import teamslam as ts
from teamslam.model import landmark_key, landmark_number


@pytest.mark.parametrize(("seed", "factor"), [(2, 0.8), (3, 1.5)])
def test_the_tag_of_another_size_is_named(seed, factor, tmp_path):
    """Also where it bends the map so much that, the rest held, it would fit nearly as it is stated."""
    room = tagged_room.make(seed=seed, seconds=24.0, rate=2.0)
    team = tagged_room.write(room, tmp_path)
    assert not ts.run(team).verdict.causes
    text = team.read_text()
    team.write_text(text.replace("[tags]\n", f"[tags]\nsizes_m = {{ 3 = {factor * tagged_room.SIZE} }}\n", 1))
    result = ts.run(team)
    (cause,) = result.verdict.causes
    assert not [*result.suspicions.sentences()]  # nobody says that it was moved, or that a robot lies
    assert cause.kind == "size" and cause.is_mistake and "the size of tag 3 is wrong" in cause.sentence
    assert float(cause.sentence.split()[-2]) == pytest.approx(tagged_room.SIZE, rel=0.02)


@pytest.mark.parametrize("factor", [1.1, 0.95])
def test_one_wrong_size_of_all_tags_is_named(factor, tmp_path):
    """Odometry and the cubes say how long a metre is."""
    team = tagged_room.write(tagged_room.make(seed=2, seconds=24.0, rate=2.0), tmp_path)
    stated = factor * tagged_room.SIZE
    team.write_text(team.read_text().replace(f"size_m = {tagged_room.SIZE}", f"size_m = {stated}"))
    (cause,) = ts.run(team).verdict.causes
    assert cause.kind == "size" and "the size of all tags is wrong" in cause.sentence
    times = float(cause.sentence.split("they fit ")[1].split()[0])
    assert times == pytest.approx(1.0 / factor, rel=0.01)
    assert float(cause.sentence.split("has lengths ")[1].split()[0]) == pytest.approx(factor, rel=0.01)


def test_a_focal_length_that_is_wrong_is_no_size(tmp_path):
    """Tags look farther away, and aside: a size explains but the first."""
    team = tagged_room.write(tagged_room.make(seed=2, seconds=24.0, rate=2.0), tmp_path)
    camera = json.loads((tmp_path / "camera.json").read_text())
    for place in (0, 4):
        camera["camera_matrix"][place] *= 1.1
    (tmp_path / "camera.json").write_text(json.dumps(camera))
    found = ts.run(team).verdict
    assert found.level == "misfit" and not [cause for cause in found.causes if cause.kind == "size"]


@pytest.mark.parametrize(("one", "other"), [(1, 3), (0, 2)])
def test_a_number_that_stands_on_two_walls_is_no_wrong_size(one, other, tmp_path):
    """The map does not fit, and its join is far from its best: no size cures that."""
    team = tagged_room.write(tagged_room.make(seed=4, seconds=24.0, rate=2.0), tmp_path)
    log = ts.read(team)
    first, second = (landmark_key(landmark_number(str(number))) for number in (one, other))
    twice = log.with_tables(replace(t, keys=np.where(t.keys == second, first, t.keys)) for t in log.tables)
    result = ts.run(replace(twice, unknowns=None))
    found = result.verdict
    assert result.apart or found.level in ("strained", "misfit")
    assert not [cause for cause in found.causes if cause.kind == "size"]
