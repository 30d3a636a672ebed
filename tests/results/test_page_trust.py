"""What is not to be believed, and what is known least, stand on the page, and are drawn."""

import base64
import json
import re
from dataclasses import replace

import numpy as np
import pytest

from hung import tied_by_heading, two_halves
from teamslam.config import Config
from teamslam.model import Dataset
from teamslam.pipeline import run
from teamslam.report import html_of
from teamslam.results import Record
from teamslam.results.page import page_bytes, page_of
from teamslam.results.words import outcome
from teamslam.sim import Options, Robot, Sensor, simulate
from teamslam.sim.faults import exchanged

REJECTING = replace(Config(), trust=replace(Config().trust, reject=True))


def drawn(record: Record) -> dict:
    """What the page's script draws from."""
    text = page_bytes(record, Config()).decode()
    return json.loads(re.search(r'id="data">(.*?)</script>', text, re.DOTALL)[1])  # type: ignore[index]


def tables(record: Record) -> dict[str, list[list[str]]]:
    """By title."""
    return {table.title: [list(row) for row in table.rows] for table in page_of(record, Config()).tables}


def misnamed() -> Dataset:
    """Robot 2 exchanges the names of two landmarks that it sees often."""
    log = simulate(Options(space="2d", robots=4), 3)
    seen = np.concatenate([t.keys[:, 1] for t in log.tables if (t.robot, t.source) == (2, "landmarks")])
    others = np.concatenate([t.keys[:, 1] for t in log.tables if t.robot != 2 and t.source == "landmarks"])
    keys, times = np.unique(seen[np.isin(seen, others)], return_counts=True)
    one, other = keys[np.argsort(times)[-2:]].tolist()
    return exchanged(log, 2, one, other)


@pytest.fixture(scope="module")
def rejecting() -> Record:
    """A run that left wrong sightings out, of landmarks and of robots."""
    kind = Robot(landmarks=Sensor(outliers=0.1), robots=Sensor("relative_pose", every=5, outliers=0.2))
    return Record.of(run(simulate(Options(space="2d", robots=4, team=(kind,)), 3), REJECTING))


def test_every_wrong_sighting_is_drawn_and_told(rejecting: Record) -> None:
    report, page = rejecting.report["rejected"], drawn(rejecting)
    count = sum(len(np.frombuffer(base64.b64decode(rows["t"]), "<f4")) for rows in page["rejected"])
    unmapped = {"landmark " + n for n in page["parts"][0]["marks"]["names"]}
    told = [row for row in report["rows"] if row["target"] in unmapped or row["target"].startswith("robot ")]
    assert count == len(told) > 100
    found = tables(rejecting)
    judged = [row for row in report["rows"] if np.isfinite(row["squared"])]
    assert sum(int(row[2]) for row in found["Wrong sightings"]) == len(judged)
    assert all(row[-1] == "0" for row in found["Wrong sightings, one by one"])
    for rows in page["rejected"]:
        target = np.frombuffer(base64.b64decode(rows["to"]), "<i4")
        assert ((target < 0) == (rows["source"] == "robots")).all()


def test_names_that_lie_stand_first_and_are_ringed() -> None:
    record = Record.of(run(misnamed()))
    [label] = record.report["suspicions"]["labels"]
    page, shown = drawn(record), page_of(record, Config())
    marks = page["parts"][0]["marks"]
    ringed = np.frombuffer(base64.b64decode(marks["doubted"]), "<i1").astype(bool)
    assert {n for n, on in zip(marks["names"], ringed, strict=True) if on} == {label["one"], label["other"]}
    said = record.report["suspicions"]["sentences"][0]
    assert any(said in alert for alert in shown.alerts)
    assert tables(record)["Not to be believed"][0] == ["a name", said]
    assert said in html_of(shown)


def test_what_is_weak_and_what_to_look_at_stand_on_the_page() -> None:
    """And where nothing is weak, neither table is there."""
    record = Record.of(run(tied_by_heading(two_halves("2d", 1), 0.2)))
    [weak] = record.report["weak"]
    found = tables(record)
    said = [part["sentence"] for part in weak["directions"]]
    assert [row[1] for row in found["What is known least"]] == [*said, weak["sentence"]]
    assert [row[1] for row in found["What to look at next"]] == [look["sentence"] for look in weak["sightings"]]
    assert len(weak["sightings"]) > 1 and all(look["after"] < look["before"] for look in weak["sightings"])
    names = [name for name, _ in outcome(record.report)]
    assert "weak" in names and "look next" in names
    part = drawn(record)["parts"][0]
    lines = np.frombuffer(base64.b64decode(part["weakest"]), "<f4").reshape(-1, 2, 3)
    middle, across = lines.mean(1) + part["origin"], (lines[:, 1] - lines[:, 0]) / 2.0
    assert middle[:, :2] == pytest.approx(np.array(weak["directions"][0]["places_m"]), abs=1e-4)
    assert across[:, :2] == pytest.approx(part["weakest_times"] * np.array(weak["directions"][0]["moved_m"]), abs=1e-4)
    firm = Record.of(run(simulate(Options(space="2d", robots=3), 1)))
    assert drawn(firm)["parts"][0]["weakest"] == ""
    assert not {"What is known least", "What to look at next", "Not to be believed"} & tables(firm).keys()
    assert "look next" not in [name for name, _ in outcome(firm.report)]


@pytest.mark.parametrize("mended", [False, True])
def test_of_what_contradicts_itself_nothing_is_said_to_be_put_right(rejecting: Record, mended: bool) -> None:
    """Names are put right by --repair; a robot's own measurements are left as they are, with it and without."""
    names, own = ["robot 1 exchanged them"], ["robot 2's own measurements contradict each other"]
    found: dict[str, object] = {key: [] for key in ("labels", "mistaken", "robots")} | {
        "themselves": {"2": 1e-9},
        "mended": mended,
    }

    def said(labels: list[str]) -> list[str]:
        told = found | {"labels": labels, "sentences": [*labels, *own]}
        rows = [value for _, value in outcome({**rejecting.report, "suspicions": told})]
        return rows[rows.index([*labels, *own][0]) :][: 2 * len(labels) + 2]

    left = "left as it is, and --repair leaves it too"
    done = "put right, or left out" if mended else "left as it is; --repair puts it right"
    assert said([]) == [*own, left]
    assert said(names) == [*names, done, *own, left]
