"""What views of a board say of a camera, and what they leave open.

A standard deviation from least squares answers for the noise of corners only. A board that is seen from one angle tells
a long lens far away from a short one nearby by effects so small that a print one thousandth longer one way, or a
distortion that another model has otherwise, outweighs them. So every candidate is fitted: models of lenses, and the
board as stated or a little stretched and bent. Two spreads are told beside the formal sigma:

    models     focal lengths of the candidates that fit as well as the best, on views that they were not fitted to
    halves     focal lengths by two halves of the views (every other eighth of them)

Where one of these, or the noise, is more than OPEN of the focal length, it is not determined by these views.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from teamslam.errors import InputError
from teamslam.frontend.boards.board import Board
from teamslam.frontend.boards.bundle import Fit, as_read, fit, left_by
from teamslam.frontend.boards.find import Views
from teamslam.geometry import Array

LENSES = (("radtan", 5), ("radtan", 8), ("equidistant", 4))
OPEN = 0.005  # of the focal length: a centimetre of a tag two metres off
PARTS = 8  # consecutive ones, of which every other is a half
LEAST = 8  # views
ALIKE_SHARE, ALIKE_SIGMAS = 0.05, 2.0  # of mean squares: candidates that differ by less fit alike


@dataclass(frozen=True, eq=False)
class Candidate:
    """A lens, on a board as stated or `loose`: its fit to all views and to both halves, and the mean square that it
    leaves of each view (n,) [pixels^2] when fitted to the other half."""

    model: str
    numbers: int
    loose: bool
    fit: Fit
    halves: tuple[Fit, Fit]
    unseen: Array

    @property
    def name(self) -> str:
        """In words."""
        lens = self.model if self.model == "equidistant" else f"{self.model} {self.numbers}"
        return f"{lens}, board free" if self.loose else lens

    @property
    def between_halves(self) -> float:
        """By how much the focal lengths of both halves differ [pixels]."""
        return abs(self.halves[0].focal - self.halves[1].focal)


@dataclass(frozen=True, eq=False)
class Calibration:
    """All candidates, the one that was `chosen`, those that fit as well (it among them), and how many corners were
    `left_out` as misread."""

    board: Board
    candidates: tuple[Candidate, ...]
    chosen: Candidate
    alike: tuple[Candidate, ...]
    left_out: int

    @property
    def between_models(self) -> tuple[float, float]:
        """The smallest and the largest focal length of candidates that fit alike [pixels]."""
        focal = [candidate.fit.focal for candidate in self.alike]
        return min(focal), max(focal)

    @property
    def sigma(self) -> float:
        """Of the focal length [pixels], as these views have it: noise, halves and models together."""
        best = self.chosen
        noise = max(best.fit.formal_sigma, best.fit.sigma_by_views)
        low, high = self.between_models
        models = max(high - best.fit.focal, best.fit.focal - low)
        return float(np.sqrt(noise**2 + (0.5 * best.between_halves) ** 2 + models**2))

    @property
    def is_determined(self) -> bool:
        """Whether models and halves agree about the focal length, and noise leaves it."""
        low, high = self.between_models
        return max(high - low, self.chosen.between_halves, self.sigma) < OPEN * self.chosen.fit.focal

    @property
    def tilts(self) -> Array:
        """Of each view (n,): between the board's normal and the camera's axis [rad]."""
        cosine = np.abs(self.chosen.fit.poses.rotation[..., 2, 2])
        return np.asarray(np.arccos(np.clip(cosine, 0.0, 1.0)))

    @property
    def distances(self) -> Array:
        """Of each view (n,): to the board's middle [m]."""
        poses = self.chosen.fit.poses
        return np.asarray(np.linalg.norm(poses.act(np.tile(self.board.points.mean(0), (len(poses), 1))), axis=-1))

    @property
    def covered(self) -> float:
        """The share of the image in which corners were seen: of 8 x 6 fields, those with one."""
        views = self.chosen.fit.views
        fields = np.floor(views.pixels / np.array(views.size) * [8, 6]).astype(int)
        return len(np.unique(np.clip(fields, 0, [7, 5]), axis=0)) / 48.0


def calibrate(views: Views, board: Board, lenses: Sequence[tuple[str, int]] = LENSES) -> Calibration:
    """The camera by views of a board, with what they leave open. Of `lenses` (model and how many numbers of distortion)
    the first that fits as well as the best is chosen; all of LENSES are fitted besides. InputError for fewer than LEAST
    views, or none that fit."""
    if len(views) < LEAST:
        raise InputError(
            f"the board was seen in {len(views)} images; a calibration needs {LEAST} at least, and some 30"
        )
    points, every = board.points, tuple(dict.fromkeys((*lenses, *LENSES)))
    first = [fit(views, points, *lens) for lens in every]
    read = as_read(min(first, key=lambda found: float(np.median(np.abs(found.residuals)))))
    if len(read) < LEAST:
        raise InputError(
            f"only {len(read)} of {len(views)} views of the board agree with any camera; are its columns, rows and "
            f"sizes as stated?"
        )
    firm = [_candidate(read, points, *lens, start, loose=False) for lens, start in zip(every, first, strict=True)]
    allowed = firm[: len(lenses)]
    best = min(firm, key=_left)
    chosen = next((one for one in allowed if _alike(one, best)), min(allowed, key=_left))
    loose = _candidate(read, points, chosen.model, chosen.numbers, chosen.fit, loose=True)
    if not _alike(chosen, loose) and not _alike(best, loose):
        chosen = loose
    best = min((*firm, loose), key=_left)
    alike = tuple(one for one in (*firm, loose) if one is chosen or _alike(one, best))
    return Calibration(board, (*firm, loose), chosen, alike, len(views.view) - len(read.view))


def _candidate(views: Views, points: Array, model: str, numbers: int, start: Fit, *, loose: bool) -> Candidate:
    whole = fit(views, points, model, numbers, loose=loose, start=start)
    side = (np.arange(len(views)) * PARTS // len(views)) % 2
    parts = [views.select(side == k) for k in (0, 1)]
    one, other = (fit(part, points, model, numbers, loose=loose, start=whole) for part in parts)
    unseen = np.zeros(len(views))
    for k, known in enumerate((other, one)):
        unseen[side == k] = left_by(known, whole.poses_of(parts[k]), parts[k], points)
    return Candidate(model, numbers, loose, whole, (one, other), unseen)


def _left(one: Candidate) -> float:
    return float(one.unseen.mean())


def _alike(one: Candidate, best: Candidate) -> bool:
    """Whether what a candidate leaves of unseen views is no more than the best does, by their own scatter."""
    more = one.unseen - best.unseen
    error = float(np.std(more)) / np.sqrt(len(more))
    return bool(more.mean() <= max(ALIKE_SIGMAS * error, ALIKE_SHARE * best.unseen.mean()))


def thinned(views: Views, most: int) -> Views:
    """At most so many views, evenly taken."""
    if len(views) <= most:
        return views
    return views.select(np.unique(np.linspace(0, len(views) - 1, most).astype(int)))
