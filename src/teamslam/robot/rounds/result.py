"""Where exact rounds ended."""

from collections.abc import Mapping
from dataclasses import dataclass

from teamslam.model import Values
from teamslam.robot.rounds.said import Said


@dataclass(frozen=True, eq=False)
class Result:
    """How rounds ended, where separators are, and where a robot's own submaps are inside, by their places. It holds no
    rows and no factors: a team that stands has none of these."""

    end: Said
    values: Values
    interiors: Mapping[int, Values]
