"""Where an unknown is moved, little of a log changes: what it took long to find is kept, and gone on from."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

import teamslam as ts
from clocks_room import read
from tag_walks import SIZE, eyes_round, ring
from teamslam.config import Config
from teamslam.frontend.streams import TagCorners
from teamslam.frontend.tags import by_targets as search
from teamslam.frontend.tags import visits
from teamslam.frontend.tags.camera import Camera
from teamslam.frontend.tags.rows import LOOKING, SQUARE
from teamslam.io.bags.seen import Seen, View
from teamslam.io.bags.team_file import CameraEntry, RobotEntry, Tags, TeamFile, Unsure
from teamslam.joining.start import starts

LENS = Camera((400.0, 400.0), (319.5, 239.5), "radtan", (0.0, 0.0, 0.0, 0.0, 0.0), (640, 480))
NOISE_PX = 0.1
SECONDS = 80.0  # of one turn: tags are visited again after a minute and more


def carried_round(seed, turns, longer, sigma):
    """A camera that is carried round a hall, its focal length `longer` than its calibration says, give or take."""
    rng = np.random.default_rng(seed)
    tags, lens = ring(rng, 20), LENS.longer(longer)
    frames, frame, ids, corners = [], [], [], []
    for _, tick, eye in eyes_round(rng, turns, seconds=SECONDS):
        frames.append(tick)
        for number in range(len(tags)):
            there = LOOKING.act(eye.unact(tags[number].act(SIZE * SQUARE)))
            pixels = lens.project(there)
            if (there[:, 2] < 0.1).any() or (pixels < 2.0).any() or (pixels > np.array(lens.size) - 3.0).any():
                continue
            frame.append(len(frames) - 1)
            ids.append(number)
            corners.append(pixels + NOISE_PX * rng.normal(size=(4, 2)))
    m = len(ids)
    found = TagCorners(
        np.array(frames), np.array(frame), np.array(ids), np.array(corners), np.zeros(m, int), ("tag36h11",) * m
    )
    place = LOOKING.inverse()
    camera = CameraEntry(
        name="eye", tags="/tags", calibration="eye.yaml", floor_px=NOISE_PX, edge_px=1e-3,
        quaternion_wxyz=tuple(place.quaternion_wxyz().tolist()), xyz_m=(0.0, 0.0, 0.0),
        sigma=Unsure(focal=sigma),
    )  # fmt: skip
    robot = RobotEntry(name="ann", recording="ann", dim=3, image_every_s=1.2, camera=[camera])
    file = TeamFile(tags=Tags(size_m=SIZE), robot=[robot])
    return read([Seen(robot, None, None, (View(camera, LENS, found),), ())], file)


@pytest.fixture
def searches(monkeypatch):
    """How often a way was led by targets, by who asked for it."""
    asked = Counter()

    def counted(module):
        def by_targets(*given):
            asked[module.__name__.rsplit(".", 1)[1]] += 1
            return search.by_targets(*given)

        monkeypatch.setattr(module, "by_targets", by_targets)

    counted(visits)
    counted(starts)
    return asked


def test_visits_are_told_apart_once(searches):
    log = carried_round(0, 2, 1.0, 0.02)
    assert searches["visits"] == 1
    again = log.unknowns.again(log.unknowns.values * 1.01)
    assert searches["visits"] == 1
    assert all(np.array_equal(a.keys, b.keys) for a, b in zip(log.tables, again.tables, strict=True))
    same = again.unknowns.again(log.unknowns.values)
    for mine, theirs in zip(log.tables, same.tables, strict=True):
        np.testing.assert_array_equal(mine.values, theirs.values)


@pytest.mark.parametrize("method", ["join", "full"])
def test_a_run_leads_a_way_by_tags_once_and_goes_on_from_there(searches, method):
    log = carried_round(1, 1, 1.02, 0.05)
    result = ts.run(log, Config(method=method))
    assert result.unknowns.found[0].told and result.unknowns.rounds > 1
    assert searches["starts"] == 1
    anew = ts.run(replace(result.dataset, unknowns=None), Config(method=method))  # by what was found
    assert searches["starts"] == 2
    keys = anew.map.values.layout.keys
    off = result.map.values.only(keys).minus(anew.map.values) / np.sqrt(np.diag(anew.map.information_of(keys)))
    assert np.abs(off).max() < 1e-2
