"""Wrong sightings in words."""

from collections.abc import Iterator

from teamslam.geometry import IntArray
from teamslam.model import Names, index_of
from teamslam.trust.cause import rows_called
from teamslam.trust.outliers.decide import Decisions

NAMED = 3  # rows of a sensor that are wrong: so few are named one by one
LARGER = 1.5  # times the stated noise, in variance, that is worth a word


def sentences_on_sightings(found: Decisions) -> Iterator[str]:
    """How many sightings of each sensor are wrong, and where the noise of the others is larger than stated."""
    for sensor in found.sensors:
        if not sensor.rejected and sensor.noise < LARGER:
            continue
        who = f"{sensor.rejected} of {sensor.rows} {rows_called(sensor.source)} of robot"
        larger = f"; the noise of the others is {sensor.noise**0.5:.1f} times as large as stated"
        which = in_brackets(sensor.which, found.names)
        yield f"{who} {found.names.robot(sensor.robot)}{which}{larger if sensor.noise >= LARGER else ''}"
    for place in found.open:
        mark, who = found.names.landmark(int(index_of(place.mark))), found.names.robot(place.robot)
        if place.larger == 1:
            others = "another has" if place.smaller == 1 else f"{place.smaller} others have"
            yield (
                f"landmark {mark} rests on one sighting, by robot {who}, and {others} it elsewhere: nobody can tell "
                f"which is right"
            )
            continue
        yield (
            f"landmark {mark} is in one of two places for robot {who}, by {place.larger} or {place.smaller} sightings, "
            f"and nobody else decides: the first was taken"
        )
    if found.undecided:
        yield f"{found.undecided} sightings are of what is in no map, and could not be judged"


def in_brackets(keys: IntArray, names: Names) -> str:
    """Which rows these are, by their keys (m, 2 or 1), where they are few; else nothing."""
    seen = (" from ".join(names.describe(key) for key in row[::-1]) for row in keys.tolist())
    return f" ({'; '.join(seen)})" if 0 < len(keys) <= NAMED else ""
