"""A tag that is larger or smaller than stated is named, with the size that it has; right ones are not."""

import pytest

import tagged_room
import teamslam as ts


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
    assert result.suspicions is None  # nobody says that it was moved
    assert cause.kind == "size" and cause.is_mistake and "the size of tag 3 is wrong" in cause.sentence
    assert float(cause.sentence.split()[-2]) == pytest.approx(tagged_room.SIZE, rel=0.02)
