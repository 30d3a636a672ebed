"""Landmark maps as YAML, for whoever navigates by them: names, places, orientations and covariances.

    frame: "robot red at 0.000 s"       # whose frame the numbers are in, in words
    units: {position: m, covariance: m^2, quaternion: wxyz}
    landmarks:
      "door": {position: [1.5, 2.0], covariance: [[0.01, 0.0], [0.0, 0.01]]}
      "tag 7": {position: [1.5, 2.0, 0.3], quaternion: [1.0, 0.0, 0.0, 0.0], covariance: ...}

Written as the part of YAML that is JSON, a landmark a line: every YAML reader takes it.
"""

from collections.abc import Sequence
from pathlib import Path

from teamslam.geometry import Array
from teamslam.io.files.text import write_text
from teamslam.io.maps.estimate import MapEstimate, paths_of
from teamslam.io.maps.marks import Mark, lost, marks_in
from teamslam.model import Dropped


def write(maps: Sequence[MapEstimate], path: Path) -> tuple[Dropped, ...]:
    """Writes each map into a file of its own. Law: every YAML reader finds the numbers to the bit."""
    for found, file in zip(maps, paths_of(path, len(maps)), strict=True):
        head = [
            f"frame: {_quoted(found.names.describe(found.base))}",
            "units: {position: m, covariance: m^2, quaternion: wxyz}",
        ]
        rows = [f"  {_quoted(mark.name)}: {_landmark(mark)}" for mark in marks_in(found)]
        write_text(file, "\n".join([*head, "landmarks:" if rows else "landmarks: {}", *rows, ""]))
    return lost(maps, "poses of robots: a landmark map has none")


def _landmark(mark: Mark) -> str:
    fields = [f"position: {_numbers(mark.position[: mark.dim])}"]
    if mark.pose is not None:
        fields.append(f"quaternion: {_numbers(mark.pose.quaternion_wxyz())}")
    if mark.covariance is not None:
        fields.append(f"covariance: [{', '.join(map(_numbers, mark.covariance))}]")
    return "{" + ", ".join(fields) + "}"


def _numbers(row: Array) -> str:
    """Numbers to the bit; with a point, without which YAML 1.1 takes 1e-05 for a word."""
    texts = (repr(number) for number in row.tolist())
    return "[" + ", ".join(text if "." in text else text.replace("e", ".0e") for text in texts) + "]"


def _quoted(text: str) -> str:
    """A word in quotes, what cannot be printed by its number."""
    plain = {'"': '\\"', "\\": "\\\\"}
    return '"' + "".join(plain.get(c, c if c.isprintable() else f"\\U{ord(c):08x}") for c in text) + '"'
