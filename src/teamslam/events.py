"""What happens to a robot, as it happens: a JSON object a line, for people and for whoever watches it.

    {"time": "2026-11-28T17:20:01.251+00:00", "event": "submap", "id": "3/0", "version": 0}

    begun, ended                     the process: with the robot's name; with its exit code
    submap                           one is held that was not: its own, or another's
    met                              another robot, for the first time
    complete, lacking                whether all that others say they hold is held here: how many are missing
    late                             rows that came too late and were left out: how many
    wrong                            a line that made no sense: why
    refused                          packets of others: why, and how many since it was told last
    journal                          trouble with the disk; empty when it is over
    left_out                         a submap that is held and in no map: why
    parked                           no rows will come any more
    revoked                          a robot is out for ever

They are the differences of what it says of itself (`Driver.status`): nothing is told twice. A file that cannot be
written to ends nothing: what was to be told waits.
"""

import json
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from teamslam.io.files.growing import Growing

Event = dict[str, Any]


class Events:
    """A file of events that grows; None: nowhere."""

    def __init__(self, path: Path | None) -> None:
        self._said = dict[str, Any]()
        self._file = None if path is None else Growing(path)

    @property
    def trouble(self) -> str:
        """What is wrong with the disk now, in words."""
        return "" if self._file is None else self._file.trouble

    def tell(self, event: str, **more: Any) -> None:
        """One event."""
        if self._file is not None:
            self._file.add(json.dumps({"time": _now(), "event": event} | more) + "\n")

    def changed(self, status: Mapping[str, Any]) -> None:
        """What has changed since the last status."""
        if self._file is not None:
            self._file.add("")  # what waits is tried again
        for event in happened(self._said, status):
            self.tell(**event)
        self._said = dict(status)

    def close(self) -> None:
        """No more will be told."""
        if self._file is not None:
            self._file.close()


def happened(before: Mapping[str, Any], after: Mapping[str, Any]) -> Iterator[Event]:
    """What happened between two statuses of a robot."""
    for what in [held for held in after.get("holds", ()) if held not in before.get("holds", ())]:
        id_, _, version = what.rpartition(", version ")
        yield {"event": "submap", "id": id_, "version": int(version)}
    for name in [name for name in after.get("links", {}) if name != "all" and name not in before.get("links", {})]:
        yield {"event": "met", "robot": name}
    late = after.get("rows", {}).get("late", 0) - before.get("rows", {}).get("late", 0)
    if late:
        yield {"event": "late", "rows": late}
    for reason, count in after.get("refused_packets", {}).items():
        more = count - before.get("refused_packets", {}).get(reason, 0)
        if more:
            yield {"event": "refused", "reason": reason, "packets": more}
    for name in [name for name in after.get("revoked", ()) if name not in before.get("revoked", ())]:
        yield {"event": "revoked", "robot": name}
    missing, was = after.get("missing", 0), before.get("missing", 0)
    if missing != was:
        yield {"event": "lacking", "submaps": missing} if missing else {"event": "complete"}
    if after.get("journal", "") != before.get("journal", ""):
        yield {"event": "journal", "trouble": after["journal"]}
    for name in [name for name in after.get("left_out", {}) if name not in before.get("left_out", {})]:
        yield {"event": "left_out", "id": name, "reason": after["left_out"][name]}
    if after.get("parked") and not before.get("parked"):
        yield {"event": "parked"}


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")
