"""What is put right in a log: before it is mapped what it rests on and what lies, and once there is a map what is wrong
with its noise."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from teamslam.config import Config
from teamslam.errors import SolveError
from teamslam.joining import ORDERS, AtMap, Joined, Unbuilt, exact_join, full, join
from teamslam.joining.join.bystanders import Bystander
from teamslam.joining.join.held_frame import with_frame
from teamslam.joining.start.blunt import blunt, with_levels
from teamslam.model import Dataset, LeftOut, Submap, Values
from teamslam.pipeline.clock import Clock
from teamslam.pipeline.mapping import build_from, pairs, pieces_of, submaps_of, whole_of, with_books
from teamslam.pipeline.renamed import Renamed
from teamslam.trust import (
    Cause,
    Decisions,
    Suspicions,
    Verdict,
    mended,
    mistakes,
    suspected_beside,
    suspicions,
    wrong_sightings,
)
from teamslam.trust.calibration import Calibration, as_stated, calibrate, rows_inside
from teamslam.trust.causes.cut import Cut
from teamslam.trust.causes.jumps import jumps
from teamslam.trust.mounts import misplaced
from teamslam.trust.turning import turning
from teamslam.trust.unknowns import Settled, settled, with_unknowns

PLACES = ("landmark", "place", "name")  # kinds of causes by which landmarks are called otherwise


def settled_by(log: Dataset, config: Config, clock: Clock) -> Settled | None:
    """The log by clocks, cameras and whatever else it rests on, estimated from itself; None where it rests on nothing
    that is uncertain."""
    if log.unknowns is None or not log.unknowns.each:
        return None
    clock.start("clocks and cameras")

    def adapted(log: Dataset) -> Dataset:
        return log if config.loss is None else log.with_loss(config.loss)

    return settled(log, config.solver, clock.tick, adapted)


def cleared(log: Dataset, config: Config, clock: Clock) -> tuple[Dataset, Decisions | None, Suspicions | None]:
    """The log without wrong sightings, and with what lies put right, where that was asked for; and what was found."""
    decisions, suspected = None, None
    if config.trust.reject:
        clock.start("wrong sightings")
        decisions = wrong_sightings(log, probability=config.trust.wrong)
        log = decisions.kept(log)
    if config.trust.repair:
        clock.start("what lies")
        suspected = _who_lies(log, submaps_of(log, config), config)
        log = log if suspected is None else mended(log, suspected)
    return log, decisions, suspected


def _who_lies(log: Dataset, submaps: Sequence[Submap], config: Config) -> Suspicions | None:
    """Who and what lies, beside the mistakes that explain a misfit."""
    try:
        joined = join(submaps, options=config.solver)
    except SolveError:
        return suspicions(log, submaps)
    wrong = mistakes(log, joined, [AtMap(log.tables, component.map) for component in joined.components])
    return suspected_beside(wrong, log, submaps, joined)


def calibrated(at: Sequence[AtMap], wrong: Sequence[Cause]) -> Calibration | None:
    """What is wrong with the noise of a log. None where the noise is left as stated: where no map is looked at (see
    `as_stated`), and where what is `wrong` is no noise, but the map, or a mistake in the log, such as degrees for
    radians; the verdict on the fit tells these, and they are for people to put right."""
    if all(as_stated(part) for part in at):
        return None
    found = calibrate(at)
    return None if found and (found.wild or wrong) else found


def in_their_places(dataset: Dataset, wrong: Sequence[Cause]) -> tuple[Dataset, tuple[Cause, ...]]:
    """A log with landmarks that were moved, or of which two carry one name, as two landmarks each, with names that lie
    put right, and without steps of odometry that contradict all else, where such are among what is `wrong`; and which
    those are. What it rests on reads so, too."""
    found = tuple(cause for cause in wrong if cause.kind in (*PLACES, "jump") and cause.mend is not None)
    for cause in found:
        assert cause.mend is not None
        mended = cause.mend(dataset)
        if dataset.unknowns is not None:
            mended = replace(mended, unknowns=Renamed(dataset.unknowns, cause.mend, mended))
        dataset = mended
    return dataset, found


def with_places_unknown(
    dataset: Dataset, log: Dataset, at: Sequence[AtMap], judged: Verdict | None
) -> tuple[Dataset, tuple[Cause, ...]]:
    """A log in which the places of sensors on their robots are to be estimated, where a map that does not fit, and no
    mistake explains, shows that some sit elsewhere than stated, or that one turns; and which those are. `judged`: where
    any sensor costs too much."""
    if judged is not None and judged.mistakes:
        return dataset, ()
    found = misplaced(log, judged.rows) if judged is not None and judged.level in ("strained", "misfit") else []
    if not found:
        with suppress(SolveError):
            found = turning(log, at)
    for cause in found:
        assert cause.mend is not None
        dataset = cause.mend(dataset)
    return dataset, tuple(found)


def has_other_places(wrong: Sequence[Cause]) -> bool:
    """Whether landmarks are in other places than called, by what is wrong."""
    return any(cause.kind in PLACES and cause.mend is not None for cause in wrong)


def only_by_the_join(log: Dataset, joined: Joined, config: Config) -> bool:
    """Whether landmarks are in other places by what joining costs alone, and not at full least squares."""
    try:
        exact = full(log, initial=joined, options=config.solver)
    except SolveError:
        return False
    told = mistakes(log, exact, [AtMap(log.tables, component.map) for component in exact.components])
    return exact.converged and not any(cause.kind in PLACES for cause in told)


def with_hidden_jumps(
    wrong: Sequence[Cause], log: Dataset, joined: Joined, decisions: Decisions | None
) -> tuple[Cause, ...]:
    """What is wrong, with the steps of odometry that contradict all else in a log where sightings were left out of its
    map for them: a step that is off there is judged by the log with its sightings."""
    if decisions is None or not decisions.rejected:
        return tuple(wrong)
    jumped = (cause for component in joined.components for cause in jumps(log, component.map, doubted=True))
    return (*(cause for cause in wrong if cause.kind != "jump"), *jumped)


def steps_cut(log: Dataset, found: Sequence[Cause]) -> tuple[LeftOut, ...]:
    """What a log loses by the steps of odometry among what is found in it."""
    return tuple(cause.mend.lost(log) for cause in found if isinstance(cause.mend, Cut))


def completed(dataset: Dataset, joined: Joined) -> tuple[Dataset, tuple[str, ...]]:
    """A log with what its first map shows to be missing for another that holds more: what ranges tell to second order
    of landmarks that lie where all who range them stand, and a frame where the world was told only in part; and which
    these are, in words."""
    words = list[str]()
    for component in joined.components if dataset.unknowns is None else ():
        found = blunt(dataset, component.map)
        dataset = with_levels(dataset, found, component.map.all_values)
        dataset, said = with_frame(dataset, component.map)
        words += [*(one.sentence(dataset.names) for one in found), *([said] if said else [])]
    return dataset, tuple(words)


NOT_AS_BEFORE = (
    "put right, the submaps do not join again as they did; the map is that of full least squares from where they lay"
)


@dataclass(frozen=True, eq=False)
class Again:
    """A log put right and mapped once more: its `pieces`, their `submaps` and what these make together (`of_submaps`);
    the map `joined`, which all rows and their systematic errors have a say in, and the `calibration` as it holds it."""

    pieces: list[Dataset]
    submaps: tuple[Submap, ...]
    of_submaps: Joined
    joined: Joined
    calibration: Calibration


def once_more(
    log: Dataset,
    config: Config,
    calibration: Calibration,
    pieces: Sequence[Dataset],
    submaps: Sequence[Submap],
    joined: Joined,
    clock: Clock,
) -> Again:
    """The map of the log put right, from the map there is. Where its submaps do not join again as they did, it is that
    of full least squares from there, which says so. SolveError where neither ends in an optimum, as that map did."""
    right, near = calibration.put_right(log), _moved(joined, calibration)
    clock.start("once more, put right")
    if config.method == "full":
        return _at_once(right, near, calibration, config)
    whole = pairs(pieces or pieces_of(log, config), submaps)
    clock.start("once more, put right", len(whole))
    right_pieces = [calibration.put_right(piece) for piece, _ in whole]
    starts = (calibration.start_of(submap) for _, submap in whole)
    made = clock.each(_built_from(start, piece, config) for start, piece in zip(starts, right_pieces, strict=True))
    pieces = [piece for piece, found in zip(right_pieces, made, strict=True) if not isinstance(found, Unbuilt)]
    built = [submap for submap, _ in whole_of(made)]
    remarks = [remark for _, remark in whole_of(made) if remark]
    if config.join.exact:
        again = exact_join(
            pieces,
            choices=[[submap] for submap in built],
            near=near,
            gap=config.join.gap,
            max_rounds=config.join.max_rounds,
            options=config.solver,
        )
    else:
        built = [
            calibration.carried_by(submap, rows_inside(submap, p)) for submap, p in zip(built, pieces, strict=True)
        ]
        again = _joined_again(built, near, config)
    if not _as_whole(again, joined):
        with suppress(SolveError):
            other = _at_once(right, near, calibration, config)
            if _as_whole(other.joined, joined):
                said = replace(other.joined, remarks=(*other.joined.remarks, NOT_AS_BEFORE))
                return replace(other, pieces=pieces, submaps=tuple(built), joined=said)
        if joined.converged and not again.converged:
            raise SolveError("with the noise put right no optimum was found from where the map lies")
    if config.join.exact:
        further, held = carrying_errors(again, calibration, right)
    else:
        further, held = _a_step_further(again, calibration, log)
    with_its_books = with_books(right, further, [*made, *_unbuilt(joined, further, right)], remarks)
    return Again(pieces, tuple(built), again, with_its_books, held)


def _at_once(right: Dataset, near: Joined, calibration: Calibration, config: Config) -> Again:
    """Full least squares of a log that was put right, from the map there is."""
    again, held = carrying_errors(full(right, initial=near, options=config.solver), calibration, right)
    books = with_books(right, again, _unbuilt(near, again, right), (), _stood_by(near, again))
    return Again([], (), again, books, held)


def _as_whole(again: Joined, before: Joined) -> bool:
    """Whether maps hold as much as those before, and have ended where those had."""
    numbers = [sum(submap.rows for submap in joined.maps) for joined in (again, before)]
    return numbers[0] >= numbers[1] and (again.converged or not before.converged)


def _built_from(start: Values, piece: Dataset, config: Config) -> tuple[Submap, str] | Unbuilt:
    try:
        return build_from(start, piece, config.solver)
    except SolveError as error:
        return Unbuilt(piece, str(error))


def _unbuilt(joined: Joined, again: Joined, log: Dataset) -> list[Unbuilt]:
    """The pieces of a log that are in no map of it, by the books of its first one, and not in another one either."""
    lost = [out for out in _lost(joined, again) if out.kind == "piece"]
    parts = (log.with_tables(t.select(out.rows.rows_of(t)) for t in log.tables) for out in lost)
    return [Unbuilt(log.with_tables(t for t in p.tables if len(t)), o.reason) for p, o in zip(parts, lost, strict=True)]


def _stood_by(joined: Joined, again: Joined) -> list[Bystander]:
    """The poses that are in no map of a log, by the books of its first one, and not in another one either."""
    return [Bystander(out.keys, out.reason) for out in _lost(joined, again) if out.kind == "poses"]


def _lost(joined: Joined, again: Joined) -> list[LeftOut]:
    """What is in no map of a log, by the books of its first one, and not in another one either."""
    known = np.concatenate([submap.keys for submap in again.maps])
    return [out for out in joined.left_out if not np.isin(out.keys, known).any()]


def carrying_unknowns(joined: Joined, log: Dataset, found: Settled) -> Joined:
    """Maps with what is uncertain of clocks and cameras among their variables."""
    known = found.known
    if known is None:
        return joined
    carried = (replace(c, map=with_unknowns(c.map, log.tables, known)) for c in joined.components)
    return replace(joined, components=tuple(carried))


def _joined_again(submaps: Sequence[Submap], near: Joined, config: Config) -> Joined:
    if config.join.order == "at once":
        return join(submaps, near=near, options=config.solver)
    return ORDERS[config.join.order](submaps, options=config.solver)


def _moved(joined: Joined, calibration: Calibration) -> Joined:
    """Maps where they go when their log is put right."""
    starts = (calibration.start_of(c.map).only(c.map.values.layout.keys) for c in joined.components)
    moved = (replace(c, map=replace(c.map, values=v)) for c, v in zip(joined.components, starts, strict=True))
    return replace(joined, components=tuple(moved))


def carrying_errors(joined: Joined, calibration: Calibration, log: Dataset) -> tuple[Joined, Calibration]:
    """Maps at the optimum of a log that was put right, with the systematic errors of its measurements among their
    variables, and the calibration as they hold it. Where no optimum was found, a map holds them by what rows say where
    it is. SolveError where rows do not determine it there."""
    components = []
    for component in joined.components:
        here = AtMap(log.tables, component.map)
        map = component.map if component.converged else here.renewed
        map, calibration = calibration.carried_on(map, here.tables)
        components.append(replace(component, map=map))
    return replace(joined, components=tuple(components)), calibration


def _a_step_further(joined: Joined, calibration: Calibration, log: Dataset) -> tuple[Joined, Calibration]:
    """Joined maps of a log that was put right, one step of least squares over all rows and systematic errors further,
    and the calibration as they hold it.

    What travels raw beside the submaps is put right by errors that a join does not doubt, and would claim to know how
    long a metre is. A map that the rows do not determine, or that costs no less after the step, stays the join.
    """
    right, components = calibration.put_right(log), []
    for component in joined.components:
        try:
            here = AtMap(right.tables, component.map)
            map, held = calibration.carried_on(here.renewed, here.tables, here.gap)
            further = held.cost(map, log) < calibration.cost_of(component.map, here.tables, here.gap.cost)
        except SolveError:
            further = False
        if further:
            component, calibration = replace(component, map=map), held
        components.append(component)
    return replace(joined, components=tuple(components)), calibration
