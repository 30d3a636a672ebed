"""A log whose unknowns are estimated with its map: mapped, moved and read again, until they stay where they are."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from teamslam.errors import SolveError
from teamslam.geometry import Array
from teamslam.joining import AtMap, Joined, full
from teamslam.model import Dataset, Unknown, Unknowns
from teamslam.solver import Options
from teamslam.trust.unknowns.agreement import contradicted
from teamslam.trust.unknowns.effects import Effects
from teamslam.trust.unknowns.known import Known, known_at
from teamslam.trust.unknowns.near import near
from teamslam.trust.unknowns.normal import Normal, normal_at
from teamslam.trust.unknowns.scan import scanned, without_meetings
from teamslam.trust.unknowns.windows import Window, windows_of

ROUNDS, MOST_ROUNDS = 10, 25  # with whole steps, and with those that lead only as far as rows can be trusted
SETTLED = 0.1  # of a sigma
BACK = 0.25  # of the step before: one that leads back by more went too far, and all are half as long from then on
TOLD = 0.5  # of the prior: what is not known better than that, the data do not tell


@dataclass(frozen=True)
class Found:
    """What was found of an unknown: the `value` by which the log was made, its standard deviation `sigma` beside the
    map, and whether the rows told it better than its prior; `sigma` is then that which they would tell it with, of a
    number that is as it was stated. `feigned`: what the rows of all landmarks together would have it be, where these
    contradict each other on it, so that it stays as stated. `windows`: what stretches say by themselves."""

    unknown: Unknown
    value: float
    sigma: float
    told: bool
    feigned: float | None = None
    windows: tuple[Window, ...] = ()


@dataclass(frozen=True, eq=False)
class Settled:
    """The log by the unknowns `found`, their `covariance` (k, k) beside the map, and the `rounds` that it took;
    `settled` is false where they still moved, `why` says why nothing was estimated; `known` is what each does to the
    rows, `joined` the map of the log by which they were found, None where there is none."""

    log: Dataset
    found: tuple[Found, ...]
    covariance: Array
    rounds: int
    settled: bool
    why: str = ""
    known: Known | None = None
    joined: Joined | None = None


def settled(
    log: Dataset,
    options: Options,
    tell: Callable[[], None] | None = None,
    adapted: Callable[[Dataset], Dataset] | None = None,
) -> Settled | None:
    """The log by the best values of its unknowns; None where it has none. `adapted` is done to each log before it is
    mapped; `tell` hears of each round."""
    if log.unknowns is None or not log.unknowns.each:
        return None
    adapted = adapted or (lambda log: log)
    if list(map(id, log.tables)) != list(map(id, log.unknowns.tables)):
        return _as_read(log, "the log was changed after it was read")
    try:
        return _settled(log, options, tell or (lambda: None), adapted)
    except SolveError as error:
        return _as_read(log, str(error))


def _as_read(log: Dataset, why: str) -> Settled:
    """Nothing found."""
    assert log.unknowns is not None
    each, values = log.unknowns.each, log.unknowns.values.tolist()
    stated = tuple(Found(unknown, value, unknown.prior, False) for unknown, value in zip(each, values, strict=True))
    return Settled(log, stated, np.diag([unknown.prior**2 for unknown in each]), 0, False, why)


def _settled(
    log: Dataset,
    options: Options,
    tell: Callable[[], None],
    adapted: Callable[[Dataset], Dataset],
    feigned: Array | None = None,
) -> Settled:
    assert log.unknowns is not None
    each = log.unknowns.each
    kept = None if feigned is None else np.isfinite(feigned)
    prior = np.array([unknown.prior for unknown in each])
    most = np.array([unknown.most for unknown in each])
    log, joined = _apart(log, options, adapted) if any(unknown.clock_of for unknown in each) else (log, None)
    share, before = 1.0, np.zeros(len(each))
    left = ROUNDS
    for rounds in range(1, MOST_ROUNDS + 1):
        tell()
        unknowns = _of(log)
        rows = adapted(log)
        joined = full(rows, initial=None if joined is None else near(joined, rows), options=options)
        maps = [AtMap(rows.tables, component.map) for component in joined.components]
        effects = Effects(unknowns, maps)
        normal = normal_at(maps, unknowns, effects, kept)
        if (normal.step / normal.sigmas) @ before < -BACK * (before @ before):
            share *= 0.5
        step, before = share * normal.step, normal.step / normal.sigmas
        done = bool((np.abs(step) < SETTLED * normal.sigmas).all())
        whole = min(1.0, float((most / np.maximum(np.abs(step), 1e-300)).min()))
        left -= whole == 1.0
        if done or not left or rounds == MOST_ROUNDS:
            break
        log = unknowns.again(unknowns.values + step * whole)
    if feigned is None and (feigned := _feigned(maps, unknowns, effects, normal)) is not None:
        stated = np.array([unknown.stated for unknown in each])
        again = unknowns.again(np.where(np.isfinite(feigned), stated, unknowns.values))
        return _settled(again, options, tell, adapted, feigned)
    told = ~normal.held & (normal.sigmas < TOLD * prior)
    windows = windows_of(maps, unknowns, effects)
    found = tuple(
        Found(unknown, float(value), float(sigma), bool(known), None if np.isnan(feint) else float(feint), window)
        for unknown, value, sigma, known, feint, window in zip(
            each,
            unknowns.values,
            normal.sigmas,
            told,
            np.full(len(each), np.nan) if feigned is None else feigned,
            windows,
            strict=True,
        )
    )
    known = known_at(maps, effects, normal.covariance)
    return Settled(log, found, normal.covariance, rounds, done, known=known, joined=joined)


def _feigned(maps: Sequence[AtMap], unknowns: Unknowns, effects: Effects, normal: Normal) -> Array | None:
    """Of unknowns (k,) that nobody called uncertain and that were moved, the values on which landmarks contradict each
    other; NaN of all others. None where there are none."""
    useful, stated = (np.array([getattr(unknown, name) for unknown in unknowns.each]) for name in ("useful", "stated"))
    moved = (useful > 0.0) & (unknowns.values != stated) & ~normal.held
    if not moved.any():
        return None
    moved &= contradicted(maps, unknowns, effects)
    return np.where(moved, unknowns.values + normal.step, np.nan) if moved.any() else None


def _apart(log: Dataset, options: Options, adapted: Callable[[Dataset], Dataset]) -> tuple[Dataset, Joined | None]:
    """The log with clocks as a map without meetings tells them, and that map where it is one; as it is where there is
    no such map."""
    try:
        joined = full(adapted(without_meetings(log)), options=options)
    except SolveError:
        return log, None
    unknowns = _of(log)
    return unknowns.again(scanned(joined, log, unknowns)), joined if len(joined.components) == 1 else None


def _of(log: Dataset) -> Unknowns:
    assert log.unknowns is not None
    return log.unknowns
