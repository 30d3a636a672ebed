"""Which set of a robot's sightings of a landmark is the landmark: decided by the team.

A robot that takes one landmark for another from time to time has sightings of it that agree on two places
(`agreement`); which is the right one it cannot know. Two robots can. Distances between landmarks are the same in both
their frames, so of all ways to pair their sets of one landmark those are right of which every two are as far apart for
the one as for the other: a largest clique again, from which comes the frame of one in the other. Then, landmark by
landmark, the sets of all robots are the vertices of a graph, two of different robots joined where they may be one
place; of the sets in which every two agree, those with most sightings win.

Source for distances: Olson, Walter, Teller, Leonard, "Single-Cluster Spectral Graph Partitioning" (RSS 2005); Lusk,
Fathian, How, "CLIPPER" (ICRA 2021).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from teamslam.geometry import Array, BoolArray, IntArray, Pose, align
from teamslam.joining.place.outline import Outline
from teamslam.joining.place.robust_fit import PLACE_SIGMA, link
from teamslam.model import Submap, chi2_quantile
from teamslam.solver import Covariances
from teamslam.trust.outliers.clique import largest_clique

PROBABILITY = 0.9999  # of two right places, and of two distances that are the same, to agree
CLOSE = 0.5  # of the larger set's sightings, that the smaller has at least where it could be the landmark
CERTAIN = 6  # pairs that are equally far from each other: more than come together by chance
FIRST_ONLY = 400  # pairs, beyond which only the first sets are paired


@dataclass(frozen=True, eq=False)
class Candidates:
    """Of one robot's piece: by row the landmark (n,), which of its sets this is, how many sightings it has; where it is
    in the piece's frame (n, 3), and the variance of that. `planar`: whether the robot moves in the plane."""

    marks: IntArray
    sets: IntArray
    sightings: IntArray
    places: Array
    variances: Array
    planar: bool

    @classmethod
    def of(cls, submap: Submap, names: Mapping[int, tuple[int, int]], sightings: Mapping[int, int]) -> "Candidates":
        """The landmarks of a submap; `names` says of each key which landmark and which of its sets it stands for.

        Law: in order of landmarks and of their sets, whatever their keys are."""
        keys = np.array(
            sorted((k for k in submap.landmark_keys.tolist() if k in names), key=names.__getitem__), np.int64
        )
        which = np.array([names[k] for k in keys.tolist()], np.int64).reshape(-1, 2)
        blocks = Covariances.of_map(submap).blocks(keys)
        spread = np.array([float(np.trace(block[:3, :3])) / len(block[:3]) for block in blocks])
        counts = np.array([sightings[k] for k in keys.tolist()], np.int64)
        places = submap.values.positions(keys, 3)
        return cls(which[:, 0], which[:, 1], counts, places, spread, submap.base_dim == 2)

    @property
    def outline(self) -> Outline:
        """The first sets alone: what most of a robot's own sightings say."""
        first = np.flatnonzero(self.sets == 0)
        first = first[np.argsort(self.marks[first])]
        n, none = len(first), np.zeros(len(first), bool)
        turns = np.tile(np.eye(3), (n, 1, 1))
        return Outline(self.marks[first], self.places[first], turns, none, self.variances[first], np.zeros(n), none)


@dataclass(frozen=True)
class Undecided:
    """A landmark that is in one of two places for a robot's piece, and nobody else decides: how many sightings each set
    has; the larger was taken."""

    piece: int
    mark: int
    larger: int
    smaller: int


def elected(pieces: Sequence[Candidates]) -> tuple[list[dict[int, int]], list[Undecided]]:
    """Of each piece the set that stands for each landmark, 0 where nobody else knows better; where that is close."""
    frames = _frames(pieces)
    close: list[Undecided] = []
    chosen: list[dict[int, int]] = [dict.fromkeys(piece.marks[piece.sets == 0].tolist(), 0) for piece in pieces]
    for mark in np.unique(np.concatenate([piece.marks for piece in pieces])).tolist():
        rows = [(n, row) for n, piece in enumerate(pieces) for row in np.flatnonzero(piece.marks == mark).tolist()]
        if not any(pieces[n].sets[row] for n, row in rows):
            continue
        winners = _winners(pieces, rows, frames)
        for n, row in winners:
            chosen[n][mark] = int(pieces[n].sets[row])
        for n in dict.fromkeys(n for n, _ in rows).keys() - {n for n, _ in winners}:
            mine = pieces[n].sightings[[row for m, row in rows if m == n]]
            if len(mine) > 1 and mine[1] >= CLOSE * mine[0]:
                close.append(Undecided(n, mark, int(mine[0]), int(mine[1])))
    return chosen, close


def _frames(pieces: Sequence[Candidates]) -> dict[tuple[int, int], Pose]:
    """The frame of one piece in another, where what they share holds it."""
    found = {}
    for one, other in combinations(range(len(pieces)), 2):
        if pieces[one].planar == pieces[other].planar and (frame := _frame(pieces[one], pieces[other])) is not None:
            found[one, other] = frame.lift(3)
    return found


def _frame(one: Candidates, other: Candidates) -> Pose | None:
    """By the sets that are equally far from each other in both; where these are few, by the first sets alone."""
    here, there = np.nonzero(one.marks[:, None] == other.marks[None])
    if len(here) > FIRST_ONLY:
        first = (one.sets[here] == 0) & (other.sets[there] == 0)
        here, there = here[first], there[first]
    between = [
        np.linalg.norm(c.places[at, None] - c.places[None, at], axis=-1) for c, at in ((one, here), (other, there))
    ]
    variance = one.variances[here] + other.variances[there] + PLACE_SIGMA**2
    gate = chi2_quantile(PROBABILITY, 1)
    alike = (between[0] - between[1]) ** 2 <= gate * (variance[:, None] + variance[None])
    clique = largest_clique(alike & (one.marks[here, None] != one.marks[None, here])).members
    if clique.sum() >= CERTAIN:
        dim = 2 if one.planar else 3
        source, target = other.places[there[clique], :dim], one.places[here[clique], :dim]
        return align(source, target, 1.0 / variance[clique]).pose
    tie = link(one.outline, other.outline, one.planar)
    return tie.frame if tie.holds else None


def _winners(
    pieces: Sequence[Candidates], rows: Sequence[tuple[int, int]], frames: Mapping[tuple[int, int], Pose]
) -> list[tuple[int, int]]:
    """The sets of one landmark that agree and have most sightings together. A set of many sightings is as many vertices
    alike, so that the largest clique has the most of them."""
    agree = np.array([[_agree(pieces, a, b, frames) for b in rows] for a in rows])
    weight = np.array([min(int(pieces[n].sightings[row]), 8) for n, row in rows])
    copies = np.repeat(np.arange(len(rows)), weight)
    graph: BoolArray = (agree | np.eye(len(rows), dtype=bool))[np.ix_(copies, copies)]
    members = np.unique(copies[largest_clique(graph).members])
    return [rows[place] for place in members.tolist()] if len(members) > 1 else []


def _agree(
    pieces: Sequence[Candidates],
    a: tuple[int, int],
    b: tuple[int, int],
    frames: Mapping[tuple[int, int], Pose],
) -> bool:
    (one, here), (other, there) = sorted((a, b))
    frame = frames.get((one, other))
    if frame is None:
        return False
    apart = pieces[one].places[here] - frame.act(pieces[other].places[there])
    allowed = pieces[one].variances[here] + pieces[other].variances[there] + PLACE_SIGMA**2
    return bool(apart @ apart <= float(chi2_quantile(PROBABILITY, 3)) * allowed)
