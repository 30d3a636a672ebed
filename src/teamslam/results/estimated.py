"""What was estimated beside a map, for people: a sentence for each number while these are few; of many one line tells
which is farthest from what was stated, and a table has them all."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from teamslam.report import Table

Report = Mapping[str, Any]

SHOWN = {"s": ("ms", 1e3), "m": ("mm", 1e3), "rad": ("degrees", 57.29577951308232), "px": ("px", 1.0)}
"""The units in which unknowns are told, and how many of them one of their own is."""

FEW = 12  # numbers that are told in a sentence each
TIMES = ("clock offset", "clock drift", "latency", "line time")  # told in a sentence each, however many there are


def estimated_lines(report: Report) -> list[str]:
    """The sentences; where numbers are many, those of times, and one for all others."""
    found = report.get("estimated") or {}
    sentences, unknowns = found.get("sentences", []), found.get("unknowns", [])
    each = list(zip(sentences, unknowns, strict=False))  # what is said of all of them comes after
    if not many(report):
        heard = [sentence for sentence, unknown in each if unknown["told"] or not unknown.get("quiet")]
        return [*heard, *sentences[len(each) :]]
    others = [(sentence, unknown) for sentence, unknown in each if unknown["name"] not in TIMES]
    told = sum(unknown["told"] for _, unknown in others)
    known = f"{told} of them" if told < len(others) else "all of them"
    sentence, _ = max(others, key=lambda one: _away(one[1]))
    summary = (
        f"{len(others)} numbers of cameras and tags, {known} now known at least twice as well as was stated (all are "
        f"in the table below). The farthest from what was stated: {sentence}"
    )
    times = [sentence for sentence, unknown in each if unknown["name"] in TIMES]
    return [*times, summary, *sentences[len(unknowns) :]]


def many(report: Report) -> bool:
    """Whether the numbers that are no times are more than a sentence each is worth."""
    found = report.get("estimated") or {}
    loud = [u for u in found.get("unknowns", []) if u["told"] or not u.get("quiet")]
    return sum(unknown["name"] not in TIMES for unknown in loud) > FEW and not found.get("why")


def estimated_table(report: Report) -> "Table":
    """All of them: the synchronisation report."""
    from teamslam.report import Table

    rows = [
        [e["of"], e["name"], _told(e, e["value"]), _told(e, e["sigma"]) if e["told"] else "not told",
         _told(e, e["stated"]), _told(e, e["prior"]), SHOWN.get(e["unit"], ("", 1.0))[0]]
        for e in (report.get("estimated") or {}).get("unknowns", [])
    ]  # fmt: skip
    columns = ("of", "what", "value", "sigma", "stated", "sigma before", "unit")
    return Table("Clocks and cameras, estimated with the map", columns, rows)


def _away(unknown: Mapping[str, Any]) -> float:
    """How far a number is from what was stated, in sigmas of that."""
    return float(abs(unknown["value"] - unknown["stated"]) / unknown["prior"])


def _told(unknown: Mapping[str, Any], number: float) -> str:
    return f"{number * SHOWN.get(unknown['unit'], ('', 1.0))[1]:.4g}"
