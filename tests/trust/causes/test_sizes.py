"""A tag that is larger or smaller than stated is named, with the size that it has; right ones are not."""

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
