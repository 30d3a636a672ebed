"""The search for what is wrong with the model of the data: sweeps over how large errors are and how they hang together.

In the first sweeps every systematic error is let in that there may be, so that none passes for noise; then those that
the data do not speak of, in the light of that noise, are left out. What a fit leaves of errors is smaller than they
are, and hangs together otherwise, as the map follows them. So the noise is found by moments: errors drawn as the model
has them go through the same fit, and the model is moved until what is left of them is as large, and hangs together as
much, as what is left of those measured.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from teamslam.geometry import Array, BoolArray
from teamslam.model import Table
from teamslam.trust.calibration.choice import Choice
from teamslam.trust.calibration.hidden import hidden
from teamslam.trust.calibration.noise import Noise
from teamslam.trust.calibration.persistence import Pairs, Persistence, tempering
from teamslam.trust.calibration.posterior import Fit
from teamslam.trust.calibration.rows import Linear, lasting_of
from teamslam.trust.calibration.sizes import LEAST, Sizes
from teamslam.trust.calibration.slips import SLIPS, Slips

SWEEPS, SETTLED = 2, 0.02  # how many at most, until scales change by less than this share
DRAWS = 16
FALSE_ALARM = 0.01  # that any scale is changed of a team whose sigmas are right
ROUNDING = 1e-6
SLIGHT = 0.03  # share of the stated variance, with which a slip begins

Kind = tuple[str, str, int]
Kinds = Mapping[Kind, tuple[Persistence, ...]]


class Search:
    """The sweeps: the noise of each table as it is taken to be by now, and what moves it."""

    def __init__(self, linear: Linear) -> None:
        self.linear, self.names = linear, linear.names
        tables = linear.tables
        self.kinds: dict[Kind, list[int]] = {}
        for k, table in enumerate(tables):
            if is_sighting(table):
                self.kinds.setdefault(table.kind, []).append(k)
        self.alike = [
            [k for k, t in enumerate(tables) if t.kind == kind] for kind in dict.fromkeys(t.kind for t in tables)
        ]
        self.pairs = {kind: Pairs.of([tables[k] for k in members], self.names) for kind, members in self.kinds.items()}
        self.stated = [Noise.stated(table) for table in tables]
        self.slips = [Slips.of(t, lasting_of(t, self.names)) for t in tables]
        self.white = np.random.default_rng(0).standard_normal((len(linear.errors), DRAWS))
        self.scales = [np.ones(noise.deviation.shape[1]) for noise in self.stated]
        self.theta = np.zeros(len(SLIPS))
        self.tempers = [np.ones((len(t), t.row.residual_rows(t.dim))) for t in tables]
        self.left = linear.by_tables(linear.errors[:, None])
        self.lasting: Kinds = {}
        self.unseen: Mapping[int, BoolArray] = {}
        self.now = self.stated

    def sweep(self) -> Fit:
        """All sweeps, or the first alone where it shows nothing wrong; the last fit."""
        fit = self._fit(tempered=False)  # every systematic error is let in
        both = self._left(fit)
        self.theta, self.scales = self._slipping(both), self._scales(both)
        if any((self.scales[k] < 1.0).any() for members in self.kinds.values() for k in members):
            self.unseen = hidden(fit, self.now, self.kinds, np.random.default_rng(1))  # by the noise as it is stated
            self.scales = self._seen(self.scales)
        if not self.theta.any() and all((scale == 1.0).all() for scale in self.scales):
            plain, lasting = fit.chosen(), self._persistences(both)
            if not plain.inside and all(part.nothing for parts in lasting.values() for part in parts):
                return plain
        self._settle(None)
        self._settle(self._fit().chosen().choice)
        return self._fit().chosen()

    def _settle(self, choice: Choice | None) -> None:
        """Sweeps with some systematic errors let in, until scales and slips settle; then how errors last."""
        for _ in range(SWEEPS):
            theta, scales = self.theta, self.scales
            self._move()
            both = self._left(self._fit(tempered=False, choice=choice))
            self.left = [part[..., :1] for part in both]
            self.theta, self.scales = self._slipping(both), self._scales(both)
            changes = [np.abs(np.log(new / old)).max() for new, old in zip(self.scales, scales, strict=True)]
            if max(changes) < SETTLED and not (self.theta.any() or theta.any()):
                break
        self._move()
        self.lasting = self._persistences(both)
        self._temper()

    def _move(self) -> None:
        """The noise by the scales and slips as they are now."""
        parts = zip(self.stated, self.scales, self.slips, strict=True)
        self.now = [noise.scaled(scale, slips, self.theta) for noise, scale, slips in parts]

    def _fit(self, *, tempered: bool = True, choice: Choice | None = None) -> Fit:
        roots = []
        for noise, left, temper in zip(self.now, self.left, self.tempers, strict=True):
            root = np.sqrt(noise.weights(left))[..., None] * noise.whitening
            roots.append(root / temper[:, None, :] if tempered else root)
        return Fit.of(self.linear, roots, choice)

    def _left(self, fit: Fit) -> list[Array]:
        """What a fit leaves (m, rows, 1 + draws) of the errors measured and of errors drawn, table by table."""
        white = self.linear.by_tables(self.white)
        drawn = [n.errors(w).reshape(-1, DRAWS) for n, w in zip(self.now, white, strict=True)]
        both = np.concatenate([self.linear.errors[:, None], np.concatenate(drawn)], 1)
        return self.linear.by_tables(fit.left(both))

    def _scales(self, both: Sequence[Array]) -> list[Array]:
        """Scales (rows,) such that draws would leave as much as is left (see `scales`)."""
        chance = by_chance(FALSE_ALARM / sum(map(len, self.scales)))
        out = list(self.scales)
        for members in self.alike:
            squares = np.stack([np.mean(self.now[k].sizes(both[k]) ** 2, 0) for k in members])
            scales, rows = np.stack([self.scales[k] for k in members]), np.array([len(both[k]) for k in members])
            for k, scale in zip(members, Sizes.of(squares, scales, rows).scales(chance), strict=True):
                out[k] = scale
        return self._seen(out)

    def _seen(self, scales: Sequence[Array]) -> list[Array]:
        """Scales without those below one of what a map hides."""
        none = np.zeros(1, bool)
        return [np.where(self.unseen.get(k, none) & (s < 1.0), 1.0, s) for k, s in enumerate(scales)]

    def _slipping(self, both: Sequence[Array]) -> Array:
        """One step towards theta (slips,) of greatest restricted likelihood, beside scales.

        Its score is Q_k = sum l_i' B_ik l_i, l = C^-1 left, beside what draws make of it; theta grows by their ratio. A
        slip that is not in comes in where chance does not make so large a Q. What scales alone explain is left out:
        errors count by how they are spread over the rows, as each part of each draw is of the same size in all.
        """
        score, stated, rows = np.zeros((len(SLIPS), DRAWS + 1)), np.zeros(len(SLIPS)), 0
        for noise, slip, errors in zip(self.now, self.slips, both, strict=True):
            if slip is not None:
                squares = np.mean(noise.sizes(errors) ** 2, 0)
                if squares[:, 1:].mean(-1).min() * len(errors) < LEAST:
                    continue
                even = errors * np.sqrt(squares.mean(-1, keepdims=True) / np.maximum(squares, 1e-300))
                pull = np.swapaxes(noise.whitening, 1, 2) @ (noise.whitening @ even)
                score += np.sum(pull * (slip.units @ pull), (1, 2))
                stated += slip.beside_stated
                rows += len(errors)
        if not score.any():
            return self.theta
        expected, spread = score[:, 1:].mean(1), score[:, 1:].std(1, ddof=1)
        begun = SLIGHT * rows / np.maximum(stated, 1e-300)
        chance = by_chance(FALSE_ALARM / len(SLIPS) / SWEEPS)
        enters = score[:, 0] > expected * (1.0 + ROUNDING) + chance * spread
        grown = self.theta * score[:, 0] / np.maximum(expected, 1e-300)
        return np.where(self.theta > 0.0, grown, np.where(enters, begun, 0.0))

    def _persistences(self, both: Sequence[Array]) -> Kinds:
        """The persistence of each part of each kind of sighting, all robots together."""
        out: dict[Kind, tuple[Persistence, ...]] = {}
        for kind, members in self.kinds.items():
            sizes = []
            for k in members:
                size = self.now[k].sizes(both[k])
                sizes.append(size / np.sqrt(np.maximum(np.mean(size**2, 0), 1e-300)))
            pooled = np.ascontiguousarray(np.swapaxes(np.concatenate(sizes), 0, 1))
            out[kind] = tuple(self.pairs[kind].persistence(part) for part in pooled)
        return out

    def _temper(self) -> None:
        for kind, members in self.kinds.items():
            tables = [self.linear.tables[k] for k in members]
            for k, temper in zip(members, tempering(tables, self.names, self.lasting[kind]), strict=True):
                self.tempers[k] = temper


def is_sighting(table: Table) -> bool:
    """Whether its errors may hang together: those of odometry are taken to be independent, as increments are."""
    return table.source != "odometry" and not table.row.unary and len(table) > 1


def by_chance(share: float) -> float:
    """How far from the mean of DRAWS draws, in their own deviations, another one lies with this probability."""
    from scipy.special import stdtrit

    return float(stdtrit(DRAWS - 1, 1.0 - 0.5 * share) * np.sqrt(1.0 + 1.0 / DRAWS))
