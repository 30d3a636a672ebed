"""What is not to be believed of a run, and what it does not know, as its page tells and draws it: from report.json."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from teamslam.answers.residuals import LANDMARK
from teamslam.report import Rows, Table
from teamslam.results.page_rows import landmarks_of
from teamslam.results.record import Record

MOST_REJECTED = 200  # told one by one
MOST_DRAWN = 10_000

Report = Mapping[str, Any]


def doubts_in(report: Report) -> list[str]:
    """The sentences on who and what is not to be believed."""
    found = report.get("suspicions")
    return [] if found is None else list(found["sentences"])


def trust_tables(report: Report) -> Iterator[Table]:
    """Who is not to be believed, what was left out as wrong, what is known least, and what to look at next."""
    yield _doubted(report)
    yield from _rejected(report)
    yield _weak(report)
    yield _look_next(report)


def doubted_marks(record: Record) -> list[str]:
    """The names of landmarks of which some name lies, or that one robot puts in two places."""
    labels = (record.report.get("suspicions") or {}).get("labels", [])
    named = [str(label[which]) for label in labels for which in ("one", "other")]
    return [*named, *(str(place["landmark"]) for place in (record.report.get("rejected") or {}).get("open", []))]


def rejected_rows(record: Record, robots: Sequence[str], start_s: float) -> list[Rows]:
    """The sightings that look wrong, by part, robot and sensor; their `size` in sigmas, of all numbers together."""
    found: dict[tuple[int, int, str], list[tuple[float, float, int]]] = {}
    marks = [landmarks_of(submap) for submap in record.maps]
    homes = [{submap.names.robot(robot) for robot in submap.robots_in_it} for submap in record.maps]
    rows = (record.report.get("rejected") or {}).get("rows", [])
    for row in rows[:: -(-len(rows) // MOST_DRAWN) or 1]:
        part = next((n for n, home in enumerate(homes) if row["robot"] in home), None)
        if part is None or row["stamp_s"] is None:
            continue
        target = _target(row["target"], marks[part], robots)
        if target is not None:
            key = (part, robots.index(row["robot"]), row["source"])
            found.setdefault(key, []).append((row["stamp_s"] - start_s, _sigmas(row), target))
    out = []
    for (part, robot, source), told in found.items():
        stamps, size, targets = (np.array(column) for column in zip(*sorted(told), strict=True))
        out.append(Rows(part, robot, source, stamps, size, targets.astype(np.int64)))
    return out


def _target(word: str, marks: Mapping[str, int], robots: Sequence[str]) -> int | None:
    """The place of a landmark, -1 - that of a robot; None for what is in no map."""
    if word.startswith(LANDMARK):
        return marks.get(word.removeprefix(LANDMARK))
    who = word.removeprefix("robot ").rpartition(" at ")[0]
    return -1 - robots.index(who) if who in robots else None


def _sigmas(row: Report) -> float:
    """How far off a row is; 0 where nobody knows."""
    squared = row["squared"]
    return float(np.sqrt(squared)) if squared is not None and np.isfinite(squared) else 0.0


def _figure(squared: float | None) -> str:
    return f"{squared**0.5:.1f}" if squared is not None and np.isfinite(squared) else "-"


def _doubted(report: Report) -> Table:
    found = report.get("suspicions") or {}
    rows = [["a name", sentence] for sentence in _of_names(found)]
    rows += [["a robot", sentence] for sentence in found.get("sentences", [])[len(rows) :]]
    note = "Put right, or left out, before this map was made." if found.get("mended") else ""
    note = note or "Left as it is; run with --repair to put it right."
    if not any(found.get(kind) for kind in ("labels", "mistaken", "robots")):
        note = "Left as it is, and --repair leaves it too: nobody can say what is wrong."
    elif found.get("themselves"):
        note += " What contradicts itself is left as it is."
    return Table("Not to be believed", ("what", "why"), rows, note)


def _of_names(found: Report) -> list[str]:
    """Sentences begin with those on names."""
    return list(found.get("sentences", [])[: len(found.get("labels", [])) + len(found.get("mistaken", []))])


def _rejected(report: Report) -> Iterator[Table]:
    found = report.get("rejected")
    if found is None or not found.get("rows"):
        return
    sensors = [
        [s["robot"], s["source"], f"{s['rejected']:,}", f"{s['rows']:,}", f"{s['rejected'] / s['rows']:.1%}",
         f"{s['noise'] ** 0.5:.2f}"]
        for s in found["sensors"] if s["rejected"]
    ]  # fmt: skip
    heads = ("robot", "sensor", "wrong", "of", "share", "noise of the others")
    done = "Left out." if found.get("left_out", True) else "Left as they are; run with --reject to leave them out."
    yield Table("Wrong sightings", heads, sensors, f"{done} Noise: times the stated standard deviation.", bars=2)
    worst = sorted(found["rows"], key=lambda row: -_sigmas(row))[:MOST_REJECTED]
    rows = [
        [row["robot"], row["source"], "-" if row["stamp_s"] is None else f"{row['stamp_s']:.3f}", row["target"],
         _figure(row["squared"]), _figure(row["gate"]), f"{row['weight']:g}"]
        for row in worst
    ]  # fmt: skip
    columns = ("robot", "sensor", "stamp [s]", "what it says it saw", "off by [sigma]", "gate [sigma]", "weight")
    most = f"The {len(rows)} that are farthest off, of {found['count']:,}; all are in report.json."
    yield Table("Wrong sightings, one by one", columns, rows, most, folded=True)


def _weak(report: Report) -> Table:
    known = [weak for weak in report.get("weak", []) if weak is not None]
    rows = [[kind, part["sentence"]] for weak in known for kind, of in (("open", "open"), ("weak", "directions"))
            for part in weak[of]]  # fmt: skip
    rows += [["all else", weak["sentence"]] for weak in known] if rows else []
    return Table("What is known least", ("", "what"), rows)


def _look_next(report: Report) -> Table:
    known = [weak for weak in report.get("weak", []) if weak is not None]
    rows = [
        [str(number), look["sentence"], f"{look['gain']:.2f}"]
        for weak in known
        for number, look in enumerate(weak.get("sightings", []), start=1)
    ]
    note = "The sightings that would firm up most what is known least, the best first; nats of all that is unknown."
    return Table("What to look at next", ("", "sighting", "gain [nats]"), rows, note)
