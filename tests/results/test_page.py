"""The page of a run holds what the run found, in every kind of world, and costs little however long the log."""

import base64
import json
import re
from dataclasses import replace

import numpy as np
import pytest

from teamslam.config import Config
from teamslam.model import Submap
from teamslam.results import Record
from teamslam.results import page as pages
from teamslam.results.page import page_bytes, page_of
from teamslam.results.words import outcome


def drawn(record: Record) -> dict:
    """What the page's script draws from."""
    text = page_bytes(record, Config()).decode()
    return json.loads(re.search(r'id="data">(.*?)</script>', text, re.DOTALL)[1])  # type: ignore[index]


def floats(text: str) -> np.ndarray:
    """Numbers of 32 bits."""
    return np.frombuffer(base64.b64decode(text), "<f4")


def test_what_is_drawn_is_the_map(record: Record) -> None:
    """Ways, landmarks and their covariances are those of the map, each robot's at its own stamps."""
    found, submap = drawn(record), record.maps[0]
    part = found["parts"][0]
    origin = np.array(part["origin"])
    for way, robot in zip(part["ways"], submap.robots_in_it, strict=True):
        assert found["robots"][way["robot"]] == submap.names.robot(robot)
        keys = submap.trajectory_keys(robot)
        np.testing.assert_allclose(floats(way["p"]).reshape(-1, 3) + origin, places(submap, keys), atol=1e-5)
        stamps = submap.names.stamps_s(keys)
        np.testing.assert_allclose(floats(way["t"]), stamps - stamps[0], atol=1e-4)
    keys = submap.landmark_keys
    np.testing.assert_allclose(floats(part["marks"]["p"]).reshape(-1, 3) + origin, places(submap, keys), atol=1e-5)
    blocks = record.covariances[0].blocks(keys)
    upper = floats(part["marks"]["c"]).reshape(-1, 6)
    np.testing.assert_allclose(upper[:, [0, 1, 3]], [[b[0, 0], b[0, 1], b[1, 1]] for b in blocks], rtol=1e-5)


def places(submap: Submap, keys: np.ndarray) -> np.ndarray:
    """In space."""
    return submap.all_values.positions(keys, 3)


def test_every_sighting_is_drawn_from_its_pose_to_its_landmark(record: Record) -> None:
    """As many rows as the log has, rising in time; targets are landmarks of the part or robots of the page."""
    found = drawn(record)
    assert sum(len(floats(rows["t"])) for rows in found["rows"]) == sum(len(r.row) for r in record.rows)
    for rows in found["rows"]:
        to = np.frombuffer(base64.b64decode(rows["to"]), "<i4")
        assert (np.diff(floats(rows["t"])) >= 0.0).all()
        assert to.max() < len(found["parts"][rows["part"]]["marks"]["names"]) and to.min() >= -len(found["robots"])
        assert (rows["source"] == "landmarks") == bool((to >= 0).all())


def test_long_logs_are_thinned_and_it_says_so(record: Record, monkeypatch: pytest.MonkeyPatch) -> None:
    """With room for fewer poses and rows than there are, no more are drawn, and the page counts them."""
    monkeypatch.setattr(pages, "MOST_POSES", 12)
    monkeypatch.setattr("teamslam.results.page_rows.MOST_ROWS", 1)
    page = page_of(record, Config())
    ways = page.parts[0].ways
    assert sum(len(way.stamps) for way in ways) <= 12 + 3 * len(ways) < sum(way.all for way in ways)
    assert len(page.thinned) == 2 and "poses" in page.thinned[0] and "rows" in page.thinned[1]


def test_a_run_read_back_draws_the_same_map(record: Record) -> None:
    """A record without residuals, as `read_run` gives it, still has a page: without sightings and residuals."""
    bare = drawn(replace(record, rows=()))
    assert bare["rows"] == [] and bare["parts"] == drawn(record)["parts"]


def test_systematic_errors_stand_in_a_table(record: Record) -> None:
    """Of a run that was calibrated, a row each; of others there is no such table."""
    known = {"robot": "1", "source": "landmarks", "model": "range_bearing", "term": "clock", "unit": "s"}
    error = {**known, "value": 0.0512, "sigma": 0.002, "prior": 0.1}
    calibrated = replace(record, report={**record.report, "calibration": {"sentences": [], "systematic": [error]}})
    tables = {table.title: table for table in page_of(calibrated, Config()).tables}
    assert tables["Calibration"].rows == [["1", "landmarks", "clock", "0.0512", "0.002", "0.1", "s"]]
    assert all(table.title != "Calibration" for table in page_of(record, Config()).tables)


def test_a_verdict_is_not_told_twice(record: Record) -> None:
    unknown = {"verdict": "unknown", "sentence": "unknown: nobody looked"}
    shown = page_of(replace(record, report={**record.report, "fit": unknown}), Config())
    assert (shown.verdict, shown.sentence) == ("unknown", "nobody looked")


def test_what_is_known_of_several_maps_says_of_which(record: Record) -> None:
    (weak,) = record.report["weak"]
    several = [value for name, value in outcome({**record.report, "weak": [weak, weak]}) if name == "known"]
    alone = [value for name, value in outcome(record.report) if name == "known"]
    assert alone == [weak["sentence"]] and several == [f"Part {n}: {weak['sentence']}" for n in (1, 2)]
