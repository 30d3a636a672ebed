"""Damaged files: what readers are fuzzed with. Only a TeamslamError or a proper result may come out of a reader."""

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from hypothesis import strategies as st

from teamslam.errors import TeamslamError

T = TypeVar("T")

WORDS = [
    "nan",
    "inf",
    "-1",
    "0",
    "1e999",
    "1e308",
    "99999999999999999999",
    "x",
    "''",
    "-0.5",
    "#",
    "1e-320",
    "{",
    "\x00",
]


@st.composite
def damaged_text(draw: st.DrawFn, text: str) -> bytes:
    """A text with a few accidents: lines gone, doubled or swapped, words replaced, cut off, bytes flipped."""
    lines = text.split("\n")
    for _ in range(draw(st.integers(1, 3))):
        at = draw(st.integers(0, len(lines) - 1))
        match draw(st.sampled_from(["drop", "double", "swap", "word", "less", "more"])):
            case "drop":
                lines = lines[:at] + lines[at + 1 :] or [""]
            case "double":
                lines.insert(at, lines[at])
            case "swap":
                other = draw(st.integers(0, len(lines) - 1))
                lines[at], lines[other] = lines[other], lines[at]
            case kind:
                words = lines[at].split(" ")
                place = draw(st.integers(0, len(words) - 1))
                words[place : place + (kind != "more")] = [] if kind == "less" else [draw(st.sampled_from(WORDS))]
                lines[at] = " ".join(words)
    return draw(damaged_bytes("\n".join(lines).encode())) if draw(st.booleans()) else "\n".join(lines).encode()


@st.composite
def damaged_bytes(draw: st.DrawFn, content: bytes) -> bytes:
    """Bytes with a few accidents: cut off, flipped, replaced by rubbish."""
    match draw(st.sampled_from(["cut", "flip", "rubbish", "insert"])):
        case "cut":
            return content[: draw(st.integers(0, len(content)))]
        case "rubbish":
            return draw(st.binary(max_size=200))
        case "insert":
            at = draw(st.integers(0, len(content)))
            return content[:at] + draw(st.binary(min_size=1, max_size=8)) + content[at:]
        case _:
            changed = bytearray(content)
            for _ in range(draw(st.integers(1, 4))):
                if changed:
                    changed[draw(st.integers(0, len(changed) - 1))] = draw(st.integers(0, 255))
            return bytes(changed)


def survives(reader: Callable[[Path], T], path: Path, content: bytes) -> T | None:
    """What a reader makes of a file: a result, or None for an error of teamslam's own; anything else is raised."""
    path.write_bytes(content)
    try:
        return reader(path)
    except TeamslamError:
        return None
