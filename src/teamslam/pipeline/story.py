"""The whole story in one page, in the paper's order:

clocks and cameras of recordings, estimated with a map
-> landmarks without names -> names, wrong sightings left out, what lies put right (where asked for)
-> split -> build (Algorithm 1) -> join (Algorithm 2)      or      full least squares on the same measurements
-> in rounds, where the join is far from that by its own account
-> steps of odometry that contradict all else left out, landmarks that were moved, as two each, places of sensors that
   are not as stated taken for unknown, names that lie beyond doubt put right, and all of this again
-> what is wrong with the model of the data; where anything is, who lies, and once more with the data put right
-> how exact the join is -> how far the map is to be believed -> covariances -> score against the truth, where known
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

from teamslam.config import Config
from teamslam.errors import InputError, SolveError
from teamslam.io import read
from teamslam.joining import AtMap, Joined, cost_of, with_exactness
from teamslam.metrics import Report, score
from teamslam.model import Dataset, LeftOut, Values, a_kind, is_unnamed
from teamslam.oddities import plain_oddities
from teamslam.pipeline.clock import Clock, Progress
from teamslam.pipeline.in_time import in_time
from teamslam.pipeline.mapping import in_rounds, mapped, on_their_sides, pairs, refuse_workers
from teamslam.pipeline.mending import (
    calibrated,
    carrying_unknowns,
    cleared,
    completed,
    has_other_places,
    in_their_places,
    once_more,
    only_by_the_join,
    settled_by,
    steps_cut,
    with_hidden_jumps,
    with_places_unknown,
)
from teamslam.pipeline.result import Result
from teamslam.scale import Workers
from teamslam.solver import Covariances, meanwhile
from teamslam.trust import (
    Cause,
    assess,
    explained,
    named_beyond_doubt,
    suspicions,
    verdict_where_costly,
    with_plain_reasons,
)
from teamslam.trust.associate import associate

DEFAULTS = Config()
FAR = 0.5  # of a join's cost, by its own approximation: it is gone on with in rounds
NOTABLE = 0.1  # of it: what a join says of landmarks that were moved is asked of full least squares
IN_ROUNDS = "joined in rounds, as by --exact, since the join of its submaps was far from full least squares"
AS_STATED = "noise is taken as stated, since the log with it put right has no map"
MOST_APART = 20  # landmarks that are called otherwise than in the log, and steps left out: of more, it says nothing


def run(
    dataset: Dataset | str | Path,
    config: Config = DEFAULTS,
    progress: Progress | None = None,
    *,
    workers: Workers | None = None,
    work: Path | None = None,
) -> Result:
    """Map a team's log by submap joining or by full least squares, as `config.method` says. `dataset` is a log, or the
    file or folder that one lies in, read with `config.read`.

    With `workers`, submaps are built and joined on them, by a tree, with the noise as it is stated; what they make lies
    in the folder `work`, from which an interrupted run goes on (None: a folder that is gone afterwards).
    Parts that cannot be joined are components of the result; what no map can be made of is in `joined.left_out`. Raises
    SolveError where that is everything, InputError where workers are asked for what they cannot do.
    """
    if workers is not None:
        refuse_workers(config)
    clock = Clock(progress)
    dataset = _log_in(dataset, config)
    if any(is_unnamed(table.keys).any() for table in dataset.tables):
        clock.start("landmarks without names")
        dataset = associate(dataset, lambda done, of: clock.hear("landmarks without names", done, of)).dataset
    result = _told(dataset, config, clock, workers, work)
    odd = tuple(plain_oddities(dataset))
    if not odd:
        return result
    return replace(result, joined=replace(result.joined, remarks=(*odd, *result.joined.remarks)))


def _told(
    dataset: Dataset,
    config: Config,
    clock: Clock,
    workers: Workers | None,
    work: Path | None,
    apart: tuple[Cause, ...] = (),
    added: tuple[str, ...] = (),
    cut: tuple[LeftOut, ...] = (),
) -> Result:
    """The story of a log whose landmarks have names; found by the map before: `apart`, those that are in two places,
    `added`, what is said of what it showed to be missing (see `completed`), and `cut`, steps that it is without."""
    found = settled_by(dataset, config, clock)
    dataset = dataset if found is None else found.log
    log = dataset if config.loss is None else dataset.with_loss(config.loss)
    try:
        as_it_is = log
        log, decisions, suspected = cleared(log, config, clock)
        near = found.joined if found is not None and log is as_it_is else None
        pieces, submaps, joined = mapped(log, config, workers, work, clock, near)
        lower, sides = on_their_sides(log, joined) if workers is None else (None, ())
        if lower is not None:
            pieces, submaps, joined = mapped(log, config, workers, work, clock, lower, lain=True)
        if found is not None and workers is None:
            joined = carrying_unknowns(joined, log, found)
    except SolveError as error:
        raise explained(error, log) from None
    if workers is None and not added:
        again, added = completed(dataset, joined)
        if added:
            return _told(again, config, clock, workers, work, apart, added, cut)
    put_out = () if suspected is None else suspected.put_out()
    said = (*added, *put_out, *sides)
    joined = replace(joined, remarks=(*joined.remarks, *said), left_out=(*joined.left_out, *cut))
    at = _at(log, joined)
    calibration, seen, judged = None, None, None
    if workers is None:
        clock.start("landmarks that were moved")
        judged = verdict_where_costly(log, joined, at)
        wrong = () if judged is None else judged.mistakes
        more = len(apart) + len(cut) < MOST_APART
        every = with_hidden_jumps(wrong, as_it_is, joined, decisions) if more else ()
        exact = config.method == "full" or config.join.exact
        placed = not exact and has_other_places(every)
        if placed and _share(joined, at) > NOTABLE and only_by_the_join(log, joined, config):
            with suppress(SolveError):
                return _told(dataset, in_rounds(config), clock, None, work, apart, (*added, _said(joined, at)), cut)
        again, moved = in_their_places(dataset, every)
        if not moved and more:
            again, moved = with_places_unknown(dataset, log, at, judged)
        if not moved and suspected is None and submaps and not config.join.exact and more:
            with meanwhile(partial(_linearised, at)):
                lies, seen = named_beyond_doubt(log, submaps, joined, wrong)
            again, moved = in_their_places(dataset, lies)
        if moved:
            apart = (*apart, *(cause for cause in moved if cause.kind != "jump"))
            return _told(again, config, clock, workers, work, apart, added, (*cut, *steps_cut(dataset, moved)))
        far = _said(joined, at) if not (wrong or exact) and _share(joined, at) > FAR else ""
        if far:  # a lie may be why, and is told by what joining costs
            suspected = suspected or seen or suspicions(log, submaps, joined)
        if far and suspected is not None and not suspected.names_a_lie:
            with suppress(SolveError):
                return _told(dataset, in_rounds(config), clock, None, work, apart, (*added, far), cut)
        if config.calibrate:
            clock.start("calibration")
            calibration = calibrated(at, wrong)
    suspects = not config.join.exact and workers is None
    if calibration:
        if suspected is None and suspects and submaps:  # who lies is told before his errors are put right
            clock.start("suspicions")
            suspected = suspicions(log, submaps, joined) if seen is None else seen
        try:
            right = once_more(log, config, calibration, pieces, submaps, joined, clock)
            pieces, submaps, joined, calibration = right.pieces, right.submaps, right.joined, right.calibration
            if suspected is not None and suspects and submaps:
                suspected = suspected.once_put_right(submaps, right.of_submaps)
            if found is not None:
                joined = carrying_unknowns(joined, calibration.put_right(log), found)
            joined = replace(joined, remarks=(*joined.remarks, *said), left_out=(*joined.left_out, *cut))
        except SolveError as error:
            calibration = None
            joined = replace(joined, remarks=(*joined.remarks, f"{AS_STATED}: {error}"))
    dataset, late = in_time(dataset, joined)
    covariances = tuple(Covariances.of_map(component.map) for component in joined.components)
    with meanwhile(partial(scores_of, joined, covariances, dataset.truth)) as scored:
        if config.method == "join":
            clock.start("exactness")
            at = [calibration.at(c.map, log) for c in joined.components] if calibration else at
            joined = with_exactness(joined, pairs(pieces, submaps), at)
        stated = log.tables if calibration else None
        if calibration:  # each row is judged by the deviation that it has alone
            log = calibration.put_right(log, weigh=False)
            joined, at = replace(joined, log=log), _at(log, joined)
        trust = assess(
            log, submaps if suspects else (), joined, at,
            judged=None if calibration else judged, stated=stated, known=suspected, seen=seen,
            rejecting=config.trust.reject, probability=config.trust.wrong, stage=clock.start,
        )  # fmt: skip
        trust = replace(trust, verdict=replace(trust.verdict, weighed=bool(calibration)))
        joined = with_plain_reasons(joined, trust.verdict)
        costs = [part.cost for part in trust.verdict.parts] or [cost_of(c.map, log.tables) for c in joined.components]
        clock.start("score")
    try:
        scores = scored()
    except SolveError as error:  # a map that has no covariances
        raise explained(error, log) from None
    return Result(
        config, dataset, submaps, joined, covariances, tuple(costs), trust, scores, clock.stop(),
        decisions, calibration, found, late, apart,
    )  # fmt: skip


def _linearised(at: Sequence[AtMap]) -> None:
    """The log linearised and factorised at its maps, which all that is said of these rests on."""
    for here in at:
        here.gap  # noqa: B018


def _share(joined: Joined, at: Sequence[AtMap]) -> float:
    """The share of its cost that full least squares would take off a join, as far as a step tells: where it is large,
    submaps are no Gaussians, and the map is another one."""
    shares = [0.0]
    for component, here in zip(joined.components, at, strict=True):
        try:
            if component.map.dof and len(here):
                shares.append(here.gap.decrease / max(here.gap.cost, 1.0))
        except SolveError:
            continue
    return max(shares)


def _said(joined: Joined, at: Sequence[AtMap]) -> str:
    """What is said of such a join."""
    return f"{IN_ROUNDS} ({_share(joined, at):.0%} of its cost)"


def _log_in(given: Dataset | str | Path, config: Config) -> Dataset:
    """The log that is given, or lies there. InputError in words for anything else."""
    if isinstance(given, str | Path):
        return read(given, None, **config.read)
    if not isinstance(given, Dataset):
        raise InputError(f"expected a log (a Dataset, or the path of one), found {a_kind(given)}")
    return given


def _at(log: Dataset, joined: Joined) -> list[AtMap]:
    return [AtMap(log.tables, component.map) for component in joined.components]


def scores_of(joined: Joined, covariances: Sequence[Covariances], truth: Values | None) -> tuple[Report, ...]:
    """Each component against the truth, each aligned by itself; nothing where no truth is known."""
    if truth is None:
        return ()
    both = zip(joined.components, covariances, strict=True)
    return tuple(score(component.map, truth, covariances=known) for component, known in both)
