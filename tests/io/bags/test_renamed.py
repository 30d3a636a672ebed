"""Tags that turn out to stand at several places change the names of rows, and nothing else of them."""

from dataclasses import fields

import numpy as np

import tagged_room
import teamslam as ts
from teamslam.frontend.tags.identities import Place
from teamslam.io.bags.seen import Book
from teamslam.io.bags.sighting_rows import renamed, sightings_of


def test_renamed_rows_are_those_that_are_read_by_the_new_names(tmp_path):
    """Of landmarks and of robots, whose rows stand beside them."""
    log = ts.read(tagged_room.write(tagged_room.make(0, 30.0, 3.0), tmp_path))
    reading = log.unknowns
    robot, team, keyframes = reading.used[0], reading.used, reading.keyframes
    before = sightings_of(robot, team, keyframes, reading.file)
    assert {table.source for table in before} == {"landmarks", "robots"}
    (landmarks,) = (table for table in before if table.source == "landmarks")
    tag, ticks = int(landmarks.keys[0, 1]), keyframes[1]
    middle = int(ticks[len(ticks) // 2])
    places = [Place(tag, 1, ((int(ticks[0]), middle),)), Place(tag, 2, ((middle + 1, int(ticks[-1])),))]
    called = robot.with_places(places, {}, Book())
    after = sightings_of(called, team, keyframes, reading.file)
    assert len(set(after[0].keys[:, 1]) - set(before[0].keys[:, 1])) in (1, 2)
    for mine, theirs in zip(renamed(before, called, team, keyframes), after, strict=True):
        for one in fields(mine):
            np.testing.assert_array_equal(getattr(mine, one.name), getattr(theirs, one.name), err_msg=one.name)
