"""What a map does not know, and what it knows least: sentences, each with the combination of unknowns that it is about.

    open:        what hangs loose, exactly (`freedoms`)
    directions:  the weakest direction of what is known, as two parts that move against each other, and how well that
                 motion is known: sigma^2 = f'P f of the function f that the sentence names, not of the direction itself
    next:        the weakest of what is left once all that has been said were known; until nothing stands out
    rest:        how well everything else is known then

So every figure is the standard deviation of what the words say, however well the two parts describe the direction.
"""

from dataclasses import dataclass

import numpy as np

from teamslam.errors import in_words
from teamslam.geometry import Array, BoolArray, rotations
from teamslam.model import Submap
from teamslam.trust.weak.directions import Conditioned, Least
from teamslam.trust.weak.freedoms import Freedom, freedoms
from teamslam.trust.weak.hinges import Hinge, hinge_of
from teamslam.trust.weak.knowledge import Knowledge, knowledge_of
from teamslam.trust.weak.parts import in_two
from teamslam.trust.weak.words import called, metres, radians, sentence_of_freedom, sentence_of_hinge

MOST = 5  # directions that are told
TOLD = 1e-6  # of a variance: less of it is left once the same motion has been told
STANDS_OUT = 0.2  # of all that is left uncertain: a direction that carries less is like many others


@dataclass(frozen=True, eq=False)
class Direction:
    """One weak direction: `part` (n,) moves against the rest of the variables by `hinge`, known to `sigma` [rad] of a
    turn, [m] of a shift. `field` (dof,) is the direction itself, of which the two parts explain a share (`explained`);
    `share` of all that was uncertain before it was told."""

    part: BoolArray
    hinge: Hinge
    sigma: float
    field: Array
    explained: float
    share: float
    sentence: str

    def __repr__(self) -> str:
        return f"Direction({in_words(self.sentence)})"

    def moved(self, places: Array) -> Array:
        """By how much places (n, d) of the part move with one sigma of it, to first order, (n, d) [m]."""
        if self.hinge.kind == "shift":
            return np.broadcast_to(self.sigma * self.hinge.axis, places.shape)
        turn = rotations(places.shape[-1]).hat(self.sigma * self.hinge.axis)
        return np.asarray((places - self.hinge.at) @ turn.T)

    @property
    def unit(self) -> str:
        """Of sigma."""
        return "m" if self.hinge.kind == "shift" else "rad"


@dataclass(frozen=True, eq=False)
class Weak:
    """What is not known of a map, and what is known least. `open`: what nothing holds, in `open_sentences`;
    `directions`, the weakest first; `least`: with these known, no place and no heading is known less well,
    relative to the map as a whole."""

    known: Knowledge
    open: tuple[Freedom, ...]
    open_sentences: tuple[str, ...]
    directions: tuple[Direction, ...]
    least: Least

    def __repr__(self) -> str:
        return f"Weak({len(self.directions)} weak directions, {len(self.open)} open)"

    @property
    def sentences(self) -> tuple[str, ...]:
        """All of it in words."""
        told = tuple(direction.sentence for direction in self.directions)
        return (*self.open_sentences, *told, self.rest)

    @property
    def rest(self) -> str:
        """How well all else is known."""
        names, least = self.known.names, self.least
        turn = f", every heading to {radians(least.heading_rad)}" if least.heading_rad > 0.0 else ""
        given = "With these known, every" if self.open or self.directions else "Every"
        beside = ", in the map as a whole" if self.known.frame.shape[1] else ""  # whichever pose is its frame
        where = f"{metres(least.place_m)}{beside} (least: {names.describe(least.place)})"
        return f"{given} place is known to {where}{turn}, or better"


def weakest(map: Submap, most: int = MOST) -> Weak:
    """The weakest directions of a finished map.

    Laws: which pose is the frame of the map makes no difference; each sigma is the standard deviation of its `hinge`'s
    function. Raises SolveError where the map is not determined.
    """
    return weakest_of(knowledge_of(map), most)


def weakest_of(known: Knowledge, most: int = MOST) -> Weak:
    """The same of what is known, which may leave parts open."""
    layout, names = known.values.layout, known.names
    loose = tuple(freedoms(known))
    told: list[Direction] = []
    left = _given(known, told)
    while len(told) < most and (found := _next(left)) is not None:
        told.append(found)
        left = _given(known, told)
    words = tuple(sentence_of_freedom(freedom, layout, names) for freedom in loose)
    return Weak(known, loose, words, tuple(told), left.least)


def _given(known: Knowledge, told: list[Direction]) -> Conditioned:
    functions = [direction.hinge.function for direction in told]
    return Conditioned(known, np.stack(functions, 1) if functions else np.zeros((known.values.layout.dof, 0)))


def _next(left: Conditioned) -> Direction | None:
    """The weakest direction of what is left; None where none stands out."""
    if not left.may_carry(STANDS_OUT):
        return None
    known = left.knowledge
    field, variance = left.weakest()
    share = variance / left.total if left.total > 0.0 else 0.0
    if share < STANDS_OUT:
        return None
    part, against, explained = _moves(known, field)
    hinge = hinge_of(known.motions, part, against, field)
    variance, rest_of_it = (float(hinge.function @ of.spread(hinge.function)) for of in (known, left))
    if min(variance, rest_of_it) <= TOLD * abs(variance):
        return None  # no two parts that have not been named describe it
    sigma = float(np.sqrt(variance))
    layout, names = known.values.layout, known.names
    rest = "the world" if not against.any() else "the rest" if against.sum() > 3 else called(against, layout, names)
    said = sentence_of_hinge(hinge, part, rest, layout, names, sigma, explained)
    return Direction(part, hinge, sigma, field, explained, share, said)


def _moves(known: Knowledge, field: Array) -> tuple[BoolArray, BoolArray, float]:
    """What moves against what in a direction, and how much of it that explains."""
    everything = np.ones(len(known.values), bool)
    if not known.frame.shape[1]:  # in the world the map as a whole may move
        motions = known.motions
        rigid = motions.columns @ motions.moved(c := motions.centroid(everything)) @ motions.fit(everything, c) @ field
        share = float(known.weight @ rigid**2) / float(known.weight @ field**2)
        if share > 0.5:
            return everything, ~everything, share
        field = field - rigid
    part, explained = in_two(known.motions, field)
    return part, ~part, explained
