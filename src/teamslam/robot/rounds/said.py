"""What questions and answers of exact rounds hold, as records."""

from dataclasses import astuple
from typing import Literal

import msgspec

from teamslam.joining.join.join import Exactness
from teamslam.solver.newton import Curvature


class Said(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """What a question says: reduce (with `curvature`), try (`state`, `share`), or end: how exact it is (`account`),
    what all measurements cost (`cost`), and whose submaps stood as they were sent (`as_sent`). `take`: go first where
    you were last asked to try."""

    kind: Literal["reduce", "try", "end"]
    take: bool = False
    curvature: Curvature = "none"
    state: bytes = b""
    share: float = 0.0
    account: tuple[float, float, float, float, float, float] = (0.0,) * 6
    cost: float = 0.0
    as_sent: tuple[int, ...] = ()


class Heard(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """What an answer says: of each submap what is left of it, or a cost; or why there is none."""

    reduced: tuple[bytes, ...] = ()
    costs: tuple[float, ...] = ()
    problem: str = ""


def account_of(exactness: Exactness) -> tuple[float, float, float, float, float, float]:
    """How exact a map is, as numbers."""
    gap, gradient, shift, of_join, rounds, size = map(float, astuple(exactness))
    return gap, gradient, shift, of_join, rounds, size


def exactness_of(said: Said) -> Exactness:
    """The same back."""
    gap, gradient, shift, of_join, rounds, size = said.account
    return Exactness(gap, gradient, shift, of_join, int(rounds), int(size))
