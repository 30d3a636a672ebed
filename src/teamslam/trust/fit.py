"""Whether the model fits the data: what a map costs beside what it should, in all and part by part.

    fits      the cost lies where it should, to within chance or a tenth
    loose     it is much lower: the standard deviations look too large, and so do the covariances
    strained  it is higher, as on many real logs: outliers, errors that are correlated, sigmas that are a bit small
    misfit    it plainly does not fit: the map is not to be trusted
    unknown   nobody can say: no measurement to spare, or no rows at hand

A misfit is one of three things: the cost is more than GROSS times what is expected (residuals three times as large as
stated, on the whole); so large are those of half the rows of some sensor of a robot, though a robust loss may forgive
them one by one; or a mistake in the log was found (see `causes`), but for landmarks in two places where the cost fits.
What a join's own approximation adds to the cost is never held against the log; a map that is far off by it alone is
`strained`, and no causes are sought: residuals there tell of the join, and of no log.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby

import numpy as np

from teamslam.cards import balance, card
from teamslam.errors import SolveError, in_words
from teamslam.joining import AtMap, Joined
from teamslam.joining.build.build import CURE
from teamslam.model import A_LOG, Dataset, Names, Table, expect, robot_of
from teamslam.trust.carriers import Share, carriers, sensor_shares
from teamslam.trust.cause import Cause
from teamslam.trust.causes.jumps import stands_out
from teamslam.trust.causes.noise import noise_causes
from teamslam.trust.causes.search import mistakes_in, mistakes_of_robots
from teamslam.trust.causes.world import mistakes_in_the_world
from teamslam.trust.noise import Noise, noise_of
from teamslam.trust.residuals import Residuals, Rows, residuals_at
from teamslam.trust.tally import kind_of, whole

GROSS = 9.0
NEAR = 0.1  # a difference of the cost that is of no matter, however sure it is
LOOSE = 0.67  # of the expected cost
FEWEST = 10  # rows of a sensor that can be refused
MOST_SENSORS = 12  # on a card


@dataclass(frozen=True, eq=False)
class Verdict:
    """How well a map fits the log that it was made of; `level` is one of those above.

    `cost` (sum of losses) beside what is `expected` and the `band` in which it lies 999 times of 1000 if the model is
    right; `chi2` counts outliers in full, `dof` is numbers measured - unknowns; `decrease` is what a step to full least
    squares would still take off, a join's own part of the cost, or, where rows are `weighed` by how their errors hang
    together, what that costs them each alone. `sensors` are all parts by robot, source and model;
    `carriers` what carries the excess, the most first: sensors, landmarks, stretches of time. `parts` are the residuals
    by component. `causes` are what it looks like, among them mistakes in the logs of robots that are in no map, which
    are not held against it. `reason` says why nothing is known, where that is so.
    """

    level: str
    cost: float
    expected: float
    band: tuple[float, float]
    chi2: float
    dof: int
    decrease: float
    sensors: tuple[Share, ...] = ()
    carriers: tuple[Share, ...] = ()
    noise: tuple[Noise, ...] = ()
    causes: tuple[Cause, ...] = ()
    parts: tuple[Residuals, ...] = ()
    names: Names = field(default_factory=Names)
    reason: str = ""
    weighed: bool = False

    def __repr__(self) -> str:
        if self.level == "unknown":
            return f"Verdict(unknown: {in_words(self.reason)})"
        return f"Verdict({self.level}: cost {self.cost:.6g}, expected {self.expected:.6g}, dof {self.dof:,})"

    def _repr_html_(self) -> str:
        if self.level == "unknown":
            return card("Fit: unknown", sentence=self.reason)
        shown, (low, high) = self.sensors[:MOST_SENSORS], self.band
        facts = [
            ("cost", f"{self.cost:,.0f}, where {self.expected:,.0f} is expected ({low:,.0f} to {high:,.0f} by chance)"),
            *((share.what, f"{share.ratio:,.2f} times what is expected of {share.rows:,} rows") for share in shown),
        ]
        picture = balance([(share.what.removeprefix("robot ").partition(" (")[0], share.ratio) for share in shown])
        said = "; ".join(cause.sentence for cause in self.causes)
        return card(f"Fit: {self.level}", facts, picture=picture, sentence=said)

    @property
    def gross(self) -> bool:
        """True where the map is not to be trusted."""
        return self.level == "misfit"

    @property
    def mistakes(self) -> tuple[Cause, ...]:
        """Those of its causes that are mistakes in the log."""
        return tuple(cause for cause in self.causes if cause.is_mistake)

    @property
    def rows(self) -> tuple[Rows, ...]:
        """The residuals of all components, table by table."""
        return tuple(row for part in self.parts for row in part.rows)


def verdict(
    dataset: Dataset,
    joined: Joined,
    at: Sequence[AtMap] | None = None,
    *,
    stated: Sequence[Table] | None = None,
) -> Verdict:
    """How well a team's map fits the log that it was made of.

    Rows of variables that the map does not hold are left out; `at`, the log at each component's map, saves linearising
    it again; `stated` are its tables with the noise that was stated, where this has been put right. Law: for the
    squared loss and a right model `cost` is distributed as chi-square with `dof` degrees of freedom where the map is
    that of full least squares.
    """
    expect(dataset, Dataset, A_LOG)
    expect(joined, Joined, "what ts.join or ts.full gave (a run has its own: run.verdict)")
    at = at or [AtMap(dataset.tables, component.map) for component in joined.components]
    try:
        parts = tuple(map(residuals_at, at))
    except SolveError as error:
        return unknown(f"the measurements themselves do not determine the map: {error}")
    rows = [row for part in parts for row in part.rows]
    dof = sum(int(row.numbers.sum()) for row in rows) - sum(part.unknowns for part in parts)
    if dof < 1:
        return unknown("every number measured was needed to make the map, and none is left to check it")
    return _judged(dataset, joined, parts, rows, dof, stated)


def mistakes(dataset: Dataset, joined: Joined, at: Sequence[AtMap]) -> tuple[Cause, ...]:
    """The mistakes in a log for which its map does not fit (see `verdict_where_costly`)."""
    judged = verdict_where_costly(dataset, joined, at)
    return () if judged is None else judged.mistakes


def verdict_where_costly(dataset: Dataset, joined: Joined, at: Sequence[AtMap]) -> Verdict | None:
    """The verdict where a sensor costs more than all its numbers should, as it does where there is any mistake in a
    table, or a step of odometry stands out; None elsewhere, and of a map that its rows do not determine."""
    costly = any(
        table.loss.cost(np.sum((u := part.system.whitened(place, part.values)) ** 2, -1)).sum() > table.dof
        or stands_out(table, u)
        for part in at
        for place, table in enumerate(part.tables)
    )
    if not costly:
        return None
    try:
        for part in at:
            part.gap  # noqa: B018
    except SolveError:
        return None
    return verdict(dataset, joined, at)


def explained(error: SolveError, log: Dataset) -> SolveError:
    """The error that a log cannot be solved with what it looks like, where a robot's log contradicts itself, or the
    world the map without it: that first, and no advice on how to solve it, which would not help."""
    found = mistakes_of_robots(log, log.robots) or mistakes_in_the_world(log)
    looks = "".join(f"the log looks like this: {cause.sentence}\n" for cause in found)
    return SolveError(f"{looks}As it is: {_bare(str(error))}", key=error.key) if found else error


def with_plain_reasons(joined: Joined, found: Verdict) -> Joined:
    """What was left out of a map with its reason, but without advice on how to solve the logs of robots in which a
    mistake was found: it would not help."""
    wrong = {robot for cause in found.causes if cause.is_mistake for robot in cause.robots}
    left_out = [
        replace(lost, reason=_bare(lost.reason)) if wrong & {*robot_of(lost.keys).tolist()} else lost
        for lost in joined.left_out
    ]
    return replace(joined, left_out=tuple(left_out))


def _bare(reason: str) -> str:
    return reason.replace(CURE, "")


def unknown(reason: str) -> Verdict:
    """The verdict where there is none."""
    none = float("nan")
    return Verdict("unknown", none, none, (none, none), none, 0, 0.0, reason=reason)


def _judged(
    dataset: Dataset,
    joined: Joined,
    parts: tuple[Residuals, ...],
    rows: Sequence[Rows],
    dof: int,
    stated: Sequence[Table] | None,
) -> Verdict:
    total, names, noise = whole(rows), dataset.names, noise_of(rows)
    cost, expected = float(total.cost[0]), float(total.expected[0])
    low, high = (float(end[0]) for end in total.band)
    decrease = min(sum(part.decrease for part in parts), max(cost - expected, 0.0))
    far = _far(cost, decrease, expected, (low, high))
    causes = mistakes_in(dataset, joined, parts, far=far, stated=stated)
    lost = {int(robot) for out in joined.left_out for robot in robot_of(out.keys) if robot > 0}
    told = {robot for cause in causes for robot in cause.robots}
    of_lost = mistakes_of_robots(dataset, lost - told)
    level = _level(cost - decrease, expected, (low, high))
    in_map = [cause for cause in causes if not lost.issuperset(cause.robots)]
    slight = level == "fits" and all(cause.kind == "landmark" for cause in in_map)
    if (in_map and not slight) or (refused(rows) and not far):
        level = "misfit"
    poor = level in ("strained", "misfit")
    if far and not in_map:
        level = "strained"  # the map is, by its join, though its measurements may agree
    elif poor and not causes:
        causes = noise_causes(noise, rows, max(cost - decrease - expected, 1.0), names)
    return Verdict(
        level=level,
        cost=cost,
        expected=expected,
        band=(low, high),
        chi2=float(sum(np.sum(row.squared) for row in rows)),
        dof=dof,
        decrease=decrease,
        sensors=tuple(sensor_shares(rows, names)),
        carriers=tuple(carriers(rows, names)) if poor else (),
        noise=tuple(noise),
        causes=(*causes, *of_lost),
        parts=parts,
        names=names,
    )


def far_by_its_join(found: Verdict) -> bool:
    """Whether a map's measurements agree with each other, and yet it is far from where they would have it."""
    return (
        found.level == "strained" and not found.weighed and _far(found.cost, found.decrease, found.expected, found.band)
    )


def _far(cost: float, decrease: float, expected: float, band: tuple[float, float]) -> bool:
    fits = _level(cost - decrease, expected, band) in ("fits", "loose")
    return fits and _level(cost, expected, band) == "misfit"


def _level(cost: float, expected: float, band: tuple[float, float]) -> str:
    if cost > max(GROSS * expected, band[1]):
        return "misfit"
    if cost < LOOSE * expected and cost < band[0]:
        return "loose"
    return "strained" if cost > max(band[1], (1.0 + NEAR) * expected) else "fits"


def refused(rows: Sequence[Rows]) -> list[tuple[int, str, str]]:
    """The sensors (robot, source, model) of which half of the rows are three times as far off as stated, or farther."""
    found = []
    for kind, group in groupby(sorted(rows, key=kind_of), kind_of):
        off = np.concatenate([r.typical for r in group])
        if len(off) >= FEWEST and np.median(off) > GROSS:
            found.append(kind)
    return found
