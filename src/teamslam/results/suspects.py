"""What was not believed, as report.json has it: wrong sightings, names that lie, robots that contradict the others."""

from typing import Any

import numpy as np

from teamslam.model import Dataset, index_of, is_pose
from teamslam.pipeline import Result
from teamslam.trust import Decisions, Suspicions, sentences_on_sightings


def wrong_of(result: Result) -> dict[str, Any] | None:
    """The sightings that look wrong, left out or not; None where there are none."""
    if result.decisions is not None:
        return _decided(result.decisions, result.dataset, left_out=True)
    wrong = result.trust.wrong
    if wrong is None or not wrong.glance:
        return None
    if wrong.decisions is not None and wrong.log is not None:
        return _decided(wrong.decisions, wrong.log, left_out=False)
    return {
        "count": None if wrong.unclear else sum(glance.wrong for glance in wrong.glance),
        "of": sum(len(table) for table in result.dataset.tables if table.source != "odometry"),
        "left_out": False,
        "sentences": list(wrong.sentences()),
    }


def _decided(found: Decisions, log: Dataset, *, left_out: bool) -> dict[str, Any]:
    """The sightings that are wrong, each with why."""
    names = found.names
    rows = []
    for table, mask, squared, gates in zip(log.tables, found.inliers, found.squared, found.gates, strict=True):
        for row in np.flatnonzero(~mask).tolist():
            observer = int(table.keys[row, 0])
            rows.append(
                {
                    "robot": names.robot(table.robot),
                    "source": table.source,
                    "row": int(table.ids[row]),
                    "stamp_s": float(names.stamps_s(np.array(observer))) if is_pose(observer) else None,
                    "target": names.describe(int(table.keys[row, -1])),
                    "weight": 0.0 if left_out else 1.0,
                    "squared": float(squared[row]),
                    "gate": float(gates[row]),
                }
            )
    return {
        "count": found.rejected,
        "of": sum(sensor.rows for sensor in found.sensors),
        "left_out": left_out,
        "sensors": [
            {
                "robot": names.robot(sensor.robot),
                "source": sensor.source,
                "rows": sensor.rows,
                "rejected": sensor.rejected,
                "wrong": sensor.wrong,
                "noise": sensor.noise,
            }
            for sensor in found.sensors
        ],
        "open": [
            {
                "robot": names.robot(place.robot),
                "landmark": names.landmark(int(index_of(place.mark))),
                "larger": place.larger,
                "smaller": place.smaller,
            }
            for place in found.open
        ],
        "undecided": found.undecided,
        "rows": rows,
        "sentences": list(sentences_on_sightings(found)),
    }


def suspicions_of(found: Suspicions, *, mended: bool) -> dict[str, Any]:
    """Names that lie, and robots that contradict the others."""
    names, judged = found.names, found.judgement
    return {
        "labels": [
            {
                "kind": label.change.kind,
                "robot": names.robot(label.change.robot),
                "one": names.landmark(int(index_of(label.change.one))),
                "other": names.landmark(int(index_of(label.change.other))),
                "odds": label.odds,
                "instead": [names.robot(robot) for robot in label.instead],
                "apart_m": label.apart_m,
            }
            for label in found.labels
        ],
        "mistaken": [
            {
                "robot": names.robot(mistake.by),
                "named": names.robot(mistake.named),
                "right": names.robot(mistake.right),
                "rows": mistake.rows,
                "odds": mistake.odds,
            }
            for mistake in found.mistaken
        ],
        "robots": [names.robot(robot) for robot in found.liars],
        "significance": judged.significance if judged is not None and judged.accused else None,
        "undecidable": judged is not None and judged.undecidable,
        "themselves": {}
        if judged is None
        else {names.robot(int(str(robot))): chance for robot, chance in judged.themselves.items()},
        "sentences": list(found.sentences()),
        "mended": mended,
    }
