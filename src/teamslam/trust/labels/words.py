"""A name that lies, in words."""

from teamslam.model import Names, index_of
from teamslam.trust.labels.robots import Mistaken
from teamslam.trust.labels.search import Finding

TEN = 2.302585
MOST = 99  # digits of odds that are written


def sentence_on_label(found: Finding, names: Names) -> str:
    """What is wrong with a robot's name of a landmark, how sure that is, and who else it may be."""
    change = found.change
    who, one = names.robot(change.robot), names.landmark(int(index_of(change.one)))
    other = names.landmark(int(index_of(change.other)))
    said = {
        "exchanged": f"robot {who} calls landmark {one} by the name of landmark {other}, and {other} by that of {one}",
        "mistaken": f"robot {who} calls landmark {other} by the name of landmark {one}",
        "apart": f"robot {who} sees landmark {one} {found.apart_m:.2f} m from where the others do: "
        f"it was moved, or is another one",
    }[change.kind]
    sure = _odds(found.odds)
    if not found.instead:
        return f"{said} ({sure})"
    others = " or ".join(f"robot {names.robot(robot)}" for robot in found.instead)
    return f"{said}, or {others} does: nobody else knows both ({sure} that one of them does)"


def sentence_on_mistaken(found: Mistaken, names: Names) -> str:
    """Which robot takes which for which."""
    by, named, right = (names.robot(robot) for robot in (found.by, found.named, found.right))
    return f"robot {by} takes robot {right} for robot {named}, in {found.rows} sightings ({_odds(found.odds)})"


def _odds(logarithm: float) -> str:
    digits = min(int(logarithm / TEN), MOST)
    return f"odds {'over ' if digits == MOST else ''}1e{digits} to 1"
