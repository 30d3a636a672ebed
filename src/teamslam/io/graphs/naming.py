"""Names and the length of a tick as a note in files of formats that have no place for them (g2o's comments, JSON)."""

from typing import Any

from teamslam.model import Names


def note_of(names: Names) -> dict[str, Any]:
    """The names as JSON content. Law: names_in(note_of(names)) = names."""
    return {
        "tick_s": names.tick_s,
        "robots": {str(number): name for number, name in names.robots.items()},
        "landmarks": {str(number): name for number, name in names.landmarks.items()},
    }


def names_in(note: Any) -> Names:
    """The names in a note. ValueError where it is none."""
    try:
        tick_s = float(note["tick_s"])
        robots, landmarks = (
            {int(number): str(name) for number, name in note[part].items()} for part in ("robots", "landmarks")
        )
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"the note of names is damaged ({error})") from None
    if not 0.0 < tick_s < 1e9:
        raise ValueError(f"the note of names is damaged (a tick of {tick_s} s)")
    return Names(robots, landmarks, tick_s)
