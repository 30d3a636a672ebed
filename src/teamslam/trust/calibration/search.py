"""The search for what is wrong with the model of the data: sweeps over how large errors are and how they hang together.

In the first sweep every systematic error is let in that there may be, so that none passes for noise; then those that
the data do not speak of, in the light of that noise, are left out. What a fit leaves of errors is smaller than they
are, and hangs together otherwise, as the map follows them. So the noise is found by moments: errors drawn as the model
has them go through the same fit, and the model is moved until what is left of them is as large, and hangs together as
much, as what is left of those measured.
"""

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from teamslam.geometry import Array, BoolArray
from teamslam.joining.join.held_frame import SOURCE as CHOSEN
from teamslam.model.sparse import sp
from teamslam.trust.calibration.balance import balanced
from teamslam.trust.calibration.choice import Choice
from teamslam.trust.calibration.components import Components, Pulls
from teamslam.trust.calibration.drawn import beside_drawn, by_chance, felt_by
from teamslam.trust.calibration.fading import refined, settles
from teamslam.trust.calibration.hidden import hidden
from teamslam.trust.calibration.noise import Noise
from teamslam.trust.calibration.persistence import WHITE, Pairs, Persistence, hanging, tempering
from teamslam.trust.calibration.posterior import Fit
from teamslam.trust.calibration.resting import under_way
from teamslam.trust.calibration.rows import Linear, is_sighting
from teamslam.trust.calibration.sizes import Sizes, in_common
from teamslam.trust.calibration.slipping import Scores
from teamslam.trust.calibration.slips import SLIPS, Slips
from teamslam.trust.calibration.steady import Steady
from teamslam.trust.calibration.successive import Successive

SWEEPS, SETTLED = 2, 0.02  # how many at most, until scales change by less than this share
REFINED = 4  # how often at most it is looked at again how errors fade
SLIPPING = 0.02  # that a slip comes in of odometry that does not, where something else is wrong
FALSE_ALARM = 0.01  # that any scale is changed of a team whose sigmas are right
LEFT = 0.25  # of the variance of sightings' errors: where a map leaves less, it makes small residuals of any errors

Kind = tuple[str, str, int]
Kinds = Mapping[Kind, tuple[Persistence, ...]]


class Search:
    """The sweeps: the noise of each table as it is taken to be by now, and what moves it."""

    def __init__(self, linear: Linear, stated: Sequence[Noise], slips: Sequence[Slips | None], white: Array) -> None:
        self.linear, self.stated, self.slips, self.white = linear, stated, slips, white
        tables = linear.tables
        self.kinds: dict[Kind, list[int]] = {}
        for k, table in enumerate(tables):
            if is_sighting(table):
                self.kinds.setdefault(table.kind, []).append(k)
        measured = [k for k, t in enumerate(tables) if t.source != CHOSEN]
        kinds = dict.fromkeys(tables[k].kind for k in measured)
        self.alike = [[k for k in measured if tables[k].kind == kind] for kind in kinds]
        self.pairs = {kind: Pairs.of([tables[k] for k in mine], linear.names) for kind, mine in self.kinds.items()}
        self.moving = [under_way(table) for table in tables]
        self.scales = [np.ones(noise.deviation.shape[1]) for noise in stated]
        self.theta = np.zeros(len(SLIPS))
        self.tempers = [np.ones((len(t), t.row.residual_rows(t.dim))) for t in tables]
        self.left = linear.by_tables(linear.errors[:, None])
        self.lasting: Kinds = {}
        self.noise = white  # (N, DRAWS) of variance one, hanging together as errors do by now
        self.unseen: Mapping[int, BoolArray] = {}
        self.now = list(stated)

    def sweep(self) -> Fit:
        """All sweeps, or the first alone where it shows nothing wrong; the last fit."""
        fit = self.fit(tempered=False)  # every systematic error is let in
        both = self._left(fit)
        self._resize(both, by_chance(FALSE_ALARM / len(SLIPS)))
        least = self._beside(self.scales)
        if any((self.scales[k] < least).any() for members in self.kinds.values() for k in members):
            self.unseen = hidden(fit, self.now, self.kinds, np.random.default_rng(1))  # by the noise as it is stated
            self.scales = self._seen(self.scales)
        self._move()
        self._hang(both)
        as_stated = not self.theta.any() and all((scale == 1.0).all() for scale in self.scales)
        if as_stated and all(part.nothing for parts in self.lasting.values() for part in parts):
            fit = fit.chosen()
            if not fit.inside:
                return fit
        self.theta = np.zeros(len(SLIPS))  # errors that hang together may pass for slips until it is known how they do
        self._move()
        self._settle(None)
        choice = self.fit().chosen().choice
        self._settle(choice)
        self._refine(choice)
        return self.fit(differing=True).chosen()

    def _settle(self, choice: Choice | None) -> None:
        """Sweeps with some systematic errors let in, until scales and slips settle; then how errors last, and, once
        they are weighed by that, how odometry slips."""
        for _ in range(SWEEPS if choice else 1):
            theta, scales = self.theta, self.scales
            fit = self.fit(tempered=False, choice=choice)
            self._resize(self._left(fit), by_chance(SLIPPING))
            self._move()
            changes = [np.abs(np.log(new / old)).max() for new, old in zip(self.scales, scales, strict=True)]
            if max(changes) < SETTLED and not (self.theta.any() or theta.any()):
                break
        self._hang(self._left(fit, self.white[:, :WHITE]))
        if choice:
            self.balance(choice)

    def balance(self, choice: Choice) -> None:
        """Odometry's scales and slips settled together (see `balance`), by a fit with some systematic errors let in."""
        if not self._slipping:
            return
        pulled = partial(self._pulled, self._steady(choice))
        self.scales, self.theta = balanced(self.slips, self.scales, self.theta, pulled, SLIPPING)
        self._move()

    def pulled(
        self, choice: Choice, components: Components, scales: Sequence[Array], theta: Array
    ) -> tuple[Pulls, Array]:
        """How what is left pulls at components of odometry's noise, and the information of these, by a fit that weighs
        rows as the map will. How errors last is known roughly, and a map by rows that count in full follows what they
        do from one to the next; one by rows that count as what they say together does so less."""
        found = self._pulled(self._steady(choice), components, scales, theta)
        self._move()
        return found

    def _pulled(
        self, steady: Steady, components: Components, scales: Sequence[Array], theta: Array
    ) -> tuple[Pulls, Array]:
        self.scales, self.theta = list(scales), theta
        self._move(self._slipping)
        left = [np.zeros((0, 0, 1 + self.noise.shape[1]))] * len(self.now)
        for k, each in zip(self._slipping, steady.leaves([self.now[k] for k in self._slipping]), strict=True):
            left[k] = each
        pulls = Pulls.of(components, self.slips, self.now, scales, theta, left)
        return pulls, steady.information(pulls.along)

    def _steady(self, choice: Choice) -> Steady:
        return Steady(self.linear, self._slipping, choice, self.now, self.noise, self.left, self._roots())

    @property
    def _slipping(self) -> list[int]:
        """The tables of which odometry's noise is settled."""
        return [k for k, slip in enumerate(self.slips) if slip is not None]

    def _refine(self, choice: Choice) -> None:
        """How errors fade of which nearly all hang together, and scales beside it, until they settle (see `fading`);
        odometry's are settled."""
        for _ in range(REFINED):
            kinds = self.lasting.items()
            which = [(kind, part) for kind, parts in kinds for part, each in enumerate(parts) if each.sharp]
            if not which:
                break
            both, before, scales = self._left(self.fit(choice=choice, differing=True)), self.lasting, self.scales
            self.left = [part[..., :1] for part in both]
            told = zip(self.slips, scales, self._seen(self._scales(both)), strict=True)
            self.scales = [new if slip is None else settled for slip, settled, new in told]
            held = {kind: list(parts) for kind, parts in before.items()}
            for kind, part in which:
                held[kind][part] = refined(self.pairs[kind], self._sizes(kind, part, both, scales), before[kind][part])
            self._temper({kind: tuple(parts) for kind, parts in held.items()})
            self._move()
            changes = [np.abs(np.log(new / old)).max() for new, old in zip(self.scales, scales, strict=True)]
            if max(changes) < SETTLED and all(settles(before[kind][part], held[kind][part]) for kind, part in which):
                break

    def _sizes(self, kind: Kind, part: int, both: Sequence[Array], scales: Sequence[Array]) -> Array:
        """One part of errors (rows, 1 + draws) of a kind, those drawn in the deviations that they had, by `scales`, and
        those measured in the deviations that they have now."""
        sizes = []
        for k in self.kinds[kind]:
            size = self.now[k].sizes(both[k])[:, part]
            sizes.append(size * np.where(np.arange(size.shape[1]) == 0, scales[k][part] / self.scales[k][part], 1.0))
        return np.concatenate(sizes)

    def fit(self, *, tempered: bool = True, differing: bool = False, choice: Choice | None = None) -> Fit:
        """The fit by the noise as it is now, of rows `tempered` as they hang together and, if `differing`, by how those
        that follow each other do; with every systematic error let in, or a choice of them."""
        return Fit.of(self.linear, self._roots(tempered), choice, self._differing() if differing else ())

    def _roots(self, tempered: bool = True) -> list[Array]:
        """w^1/2 W (m, r, r) of each table, tempered or not."""
        roots = []
        for noise, left, temper in zip(self.now, self.left, self.tempers, strict=True):
            root = np.sqrt(noise.weights(left))[..., None] * noise.whitening
            roots.append(root / temper[:, None, :] if tempered else root)
        return roots

    def _differing(self) -> list[sp.csr_array | None]:
        """What takes the errors of each table to how those that follow each other differ, by its noise; None where they
        say nothing of it."""
        out: list[sp.csr_array | None] = [None] * len(self.now)
        for kind, held in self.lasting.items():
            if not any(each.sharp for each in held):
                continue
            for k in self.kinds[kind]:
                noise = self.now[k]
                successive = Successive.of(noise.table, self.linear.names, held)
                root = np.sqrt(noise.weights(self.left[k]))[..., None] * noise.all_whitening
                out[k] = successive.whitened(root)
        return out

    def _left(self, fit: Fit, white: Array | None = None) -> list[Array]:
        """What a fit leaves (m, rows, 1 + draws) of the errors measured and of errors drawn, from `white` noise or from
        such as hangs together as errors do, table by table."""
        drawn = self.linear.by_tables(self.noise if white is None else white)
        errors = beside_drawn(self.linear, self.now, drawn)
        felt = felt_by(self.now, self.left, errors, self.linear)
        return self.linear.by_tables(fit.left(errors) if felt is None else fit.left(felt) + (errors - felt))

    def _hanging(self) -> Array:
        """White noise made to hang together as errors do by now."""
        parts = self.linear.by_tables(self.white)
        for kind, members in self.kinds.items():
            held = self.lasting.get(kind, ())
            if any(not part.nothing for part in held):
                for k in members:
                    parts[k] = hanging(parts[k], self.linear.tables[k], self.linear.names, held)
        return np.concatenate([part.reshape(-1, part.shape[-1]) for part in parts])

    def _resize(self, both: Sequence[Array], chance: float) -> None:
        """Scales and slips one step nearer to where draws leave as much as is left; a slip comes in where it stands out
        by more than `chance`."""
        self.left = [part[..., :1] for part in both]
        self.theta = Scores.of(self.slips, self.now, both).step(self.theta, chance)
        self.scales = self._seen(self._scales(both))

    def _move(self, which: Sequence[int] | None = None) -> None:
        """The noise by the scales and slips as they are now, of all tables or of some."""
        now = list(self.now)
        for k in range(len(now)) if which is None else which:
            now[k] = self.stated[k].scaled(self.scales[k], self.slips[k], self.theta)
        self.now = now

    def _scales(self, both: Sequence[Array]) -> list[Array]:
        """Scales (rows,) such that draws would leave as much as is left (see `sizes`)."""
        chance = by_chance(FALSE_ALARM / sum(map(len, self.scales)))
        found = [self._sizes_of(members, both) for members in self.alike]
        alone = self._by_tables([sizes.scales(chance) for sizes in found])
        common = self._in_common(alone)
        if common == 1.0:
            return alone
        beside = self._by_tables([sizes.scales(chance, common) for sizes in found])
        return (
            alone if any((scales == 1.0).any() for scales in beside) else beside
        )  # something is right as it is stated

    def _sizes_of(self, members: Sequence[int], both: Sequence[Array]) -> Sizes:
        squares = np.stack([self.now[k].squares(both[k], self.moving[k]) for k in members])
        scales, rows = np.stack([self.scales[k] for k in members]), np.array([self.moving[k].sum() for k in members])
        least = LEFT if is_sighting(self.linear.tables[members[0]]) else 0.0
        return Sizes.of(squares, scales, rows, least)

    def _by_tables(self, of_kinds: Sequence[Array]) -> list[Array]:
        """What is told of tables kind by kind (k, rows), table by table; of what was no measurement nothing."""
        told = {
            k: each
            for members, of in zip(self.alike, of_kinds, strict=True)
            for k, each in zip(members, of, strict=True)
        }
        return [told.get(k, np.ones_like(scale)) for k, scale in enumerate(self.scales)]

    def _in_common(self, scales: Sequence[Array]) -> float:
        """What all scales but those of what a map hides have in common."""
        by_source: dict[str, list[Array]] = {}
        for k, (table, each) in enumerate(zip(self.linear.tables, scales, strict=True)):
            by_source.setdefault(table.source, []).append(each[~self.unseen.get(k, np.zeros(len(each), bool))])
        return in_common(by_source)

    def _seen(self, scales: Sequence[Array]) -> list[Array]:
        """Scales without those below odometry's of what a map hides: in proportion to it, as both are stated. What
        comes out as stated stays so."""
        none, least = np.zeros(1, bool), self._beside(scales)
        return [np.where(self.unseen.get(k, none) & (s < least) & (s != 1.0), least, s) for k, s in enumerate(scales)]

    def _beside(self, scales: Sequence[Array]) -> float:
        """What odometry's deviations are scaled by, in the middle of its parts; as stated where there is none."""
        own = [s for s, table in zip(scales, self.linear.tables, strict=True) if table.is_odometry]
        return float(np.median(np.concatenate(own))) if own else 1.0

    def _hang(self, both: Sequence[Array]) -> None:
        """How errors of each part of each kind of sighting last, all robots together, and what that leaves of them."""
        self._temper({kind: self._persistences(kind, both) for kind in self.kinds})

    def _temper(self, lasting: Kinds) -> None:
        """Rows by what those that hang together so count."""
        self.lasting = lasting
        for kind, members in self.kinds.items():
            tables = [self.linear.tables[k] for k in members]
            for k, temper in zip(members, tempering(tables, self.linear.names, self.lasting[kind]), strict=True):
                self.tempers[k] = temper
        self.noise = self._hanging()

    def _persistences(self, kind: Kind, both: Sequence[Array]) -> tuple[Persistence, ...]:
        sizes = []
        for k in self.kinds[kind]:
            size = self.now[k].sizes(both[k])
            sizes.append(size / np.sqrt(np.maximum(np.mean(size**2, 0), 1e-300)))
        pooled = np.concatenate(sizes)
        return tuple(self.pairs[kind].persistence(pooled[:, part]) for part in range(pooled.shape[1]))
