"""The whole story in one page, in the paper's order:

landmarks without names -> names, wrong sightings left out, what lies put right (where asked for)
-> split -> build (Algorithm 1) -> join (Algorithm 2)      or      full least squares on the same measurements
-> what is wrong with the model of the data; where it is, once more with the data put right
-> how exact the join is -> how far the map is to be believed -> covariances -> score against the truth, where known
"""

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeVar

from teamslam.answers import Answers, ResidualTable
from teamslam.answers.maps_card import facts_of, maps_card
from teamslam.config import Config
from teamslam.errors import InputError, SolveError
from teamslam.io import read
from teamslam.joining import (
    ORDERS,
    AtMap,
    Cost,
    Joined,
    Unbuilt,
    accounted,
    build_choices,
    build_with_solution,
    cost_of,
    exact_join,
    full,
    split,
    with_exactness,
)
from teamslam.metrics import Report, score
from teamslam.model import Dataset, Sources, Submap, Values, a_kind, is_unnamed
from teamslam.scale import Workers, gather, join_in_tree
from teamslam.solver import Covariances, Options, each_side_by_side, meanwhile
from teamslam.trust import (
    Assessment,
    Decisions,
    Suspicions,
    Verdict,
    assess,
    explained,
    mended,
    sentence,
    suspicions,
    with_plain_reasons,
    wrong_sightings,
)
from teamslam.trust.associate import associate
from teamslam.trust.calibration import Calibration, calibrate
from teamslam.wire.pieces import write_pieces

T = TypeVar("T")
Progress = Callable[[str, int, int], None]
"""Hears the stage, how much of it is done, and of how much (0: nobody knows)."""

DEFAULTS = Config()
LONG = 5000  # rows of a piece from which on its computing outweighs the Python around it


@dataclass(frozen=True, eq=False)
class Result(Answers):
    """A finished run, asked by name (see `teamslam.answers`): what went in, what came out, seconds of each stage.

    `map` is the first component: the one of the lowest robot. `covariances`, `costs` and `scores` have those of each;
    a cost is None where the raw measurements are not at hand, and `scores` is empty where no truth is known. `submaps`
    is empty for full least squares. `trust` says how far the map is to be believed, `decisions` which sightings were
    wrong and left out, where that was asked for; `calibration` what was wrong with the model of the data, and was put
    right.
    """

    config: Config
    dataset: Dataset
    submaps: tuple[Submap, ...]
    joined: Joined
    covariances: tuple[Covariances, ...]
    costs: tuple[Cost | None, ...]
    trust: Assessment
    scores: tuple[Report, ...]
    seconds: dict[str, float]
    decisions: Decisions | None = None
    calibration: Calibration = field(default_factory=Calibration)

    @property
    def map(self) -> Submap:
        """The joined map."""
        return self.joined.map

    @property
    def verdict(self) -> Verdict:
        """How well the map fits."""
        return self.trust.verdict

    @property
    def suspicions(self) -> Suspicions | None:
        """Which names and robots are not to be believed, put right where that was asked for; None where nobody looked
        (full least squares, exact joins, workers)."""
        return self.trust.suspicions

    @property
    def maps(self) -> tuple[Submap, ...]:
        """One for each component."""
        return self.joined.maps

    @property
    def truth(self) -> Values | None:
        """What the log knows of the truth."""
        return self.dataset.truth

    def residuals(self) -> ResidualTable:
        """How far every row of the log is off at the maps."""
        return self.joined.residuals()

    def __repr__(self) -> str:
        return f"Result({'; '.join(value for _, value in self._facts())}; {sentence(self.verdict)})"

    def _repr_html_(self) -> str:
        scores = [(f"errors{_part(n, self.scores)}", found.headline) for n, found in enumerate(self.scores, 1)]
        facts = [*self._facts(), *scores, ("took", f"{sum(self.seconds.values()):.1f} s")]
        return maps_card(self.dataset.origin or "A team's map", self, facts, sentence(self.verdict))

    def _facts(self) -> list[tuple[str, str]]:
        return [*facts_of(self), ("state", "converged" if self.joined.converged else "not converged")]


def _part(number: int, of: Sequence[object]) -> str:
    return f", part {number}" if len(of) > 1 else ""


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

    With `workers`, submaps are built and joined on them, by a tree; what they make lies in the folder `work`, from
    which an interrupted run goes on (None: a folder that is gone afterwards).
    Parts that cannot be joined are components of the result; what no map can be made of is in `joined.left_out`. Raises
    SolveError where that is everything, InputError where workers are asked for what they cannot do.
    """
    if workers is not None:
        refuse_workers(config)
    clock = Clock(progress)
    dataset = _log_in(dataset, config)
    if any(is_unnamed(table.keys).any() for table in dataset.tables):
        clock.start("landmarks without names")
        dataset = associate(dataset).dataset
    log = dataset if config.loss is None else dataset.with_loss(config.loss)
    try:
        log, decisions, suspected = _cleared(log, config, clock)
        pieces, submaps, joined = _solved(log, config, workers, work, clock)
    except SolveError as error:
        raise explained(error, log) from None
    at = _at(log, joined)
    calibration = Calibration()
    if config.calibrate:
        clock.start("calibration")
        calibration = calibrate(at)
    if not calibration.nothing:
        pieces, submaps, joined = _once_more(log, config, calibration, pieces, submaps, joined, clock)
    covariances = tuple(Covariances.of_map(component.map) for component in joined.components)
    asked = covariances if dataset.truth is not None else ()  # scores want those of every variable
    with meanwhile(lambda: [known.all for known in asked]):
        if config.method == "join":
            clock.start("exactness")
            at = at if calibration.nothing else _at(calibration.put_right(log), joined)
            joined = with_exactness(joined, pairs(pieces, submaps), at)
        if not calibration.nothing:  # each row is judged by the deviation that it has alone
            log = calibration.put_right(log, weigh=False)
            at = _at(log, joined)
        apart = () if config.join.exact or workers is not None else submaps
        trust = assess(log, apart, joined, at, known=suspected, stage=clock.start)
        joined = with_plain_reasons(joined, trust.verdict)
        costs = [part.cost for part in trust.verdict.parts] or [cost_of(c.map, log.tables) for c in joined.components]
        clock.start("covariances")
    clock.start("score")
    try:
        scores = scores_of(joined, covariances, dataset.truth)
    except SolveError as error:  # a map that has no covariances
        raise explained(error, log) from None
    return Result(
        config, dataset, submaps, joined, covariances, tuple(costs), trust, scores, clock.stop(), decisions, calibration
    )


def _cleared(log: Dataset, config: Config, clock: "Clock") -> tuple[Dataset, Decisions | None, Suspicions | None]:
    """The log without wrong sightings, and with what lies put right, where that was asked for; and what was found."""
    decisions, suspected = None, None
    if config.trust.reject:
        clock.start("wrong sightings")
        decisions = wrong_sightings(log, probability=config.trust.wrong)
        log = decisions.kept(log)
    if config.trust.repair:
        clock.start("what lies")
        suspected = _suspicions_of(log, config)
        log = mended(log, suspected)
    return log, decisions, suspected


def _once_more(
    log: Dataset,
    config: Config,
    calibration: Calibration,
    pieces: Sequence[Dataset],
    submaps: Sequence[Submap],
    joined: Joined,
    clock: "Clock",
) -> tuple[list[Dataset], tuple[Submap, ...], Joined]:
    """The map of the log put right, from the map there is."""
    right = calibration.put_right(log)
    clock.start("once more, put right")
    if config.method == "full":
        again = full(right, initial=_moved(joined, calibration), options=config.solver)
        return [], (), replace(_carrying(again, calibration, right), left_out=joined.left_out, remarks=joined.remarks)
    whole = pairs(pieces or _pieces(log, config), submaps)
    clock.start("once more, put right", len(whole))
    pieces = [calibration.put_right(piece) for piece, _ in whole]
    both = zip(pieces, (submap for _, submap in whole), strict=True)
    built = clock.each(
        build_with_solution(piece, options=config.solver, near=calibration.start_of(submap))[0]
        for piece, submap in both
    )
    if config.join.exact:
        again = exact_join(
            pieces,
            choices=[[submap] for submap in built],
            gap=config.join.gap,
            max_rounds=config.join.max_rounds,
            options=config.solver,
        )
        again = _carrying(again, calibration, right)
    else:
        carried = [calibration.carried_by(submap, piece) for submap, piece in zip(built, pieces, strict=True)]
        again, built = ORDERS[config.join.order](carried, options=config.solver), tuple(carried)
    return pieces, built, replace(again, left_out=joined.left_out, remarks=joined.remarks)


def _at(log: Dataset, joined: Joined) -> list[AtMap]:
    return [AtMap(log.tables, component.map) for component in joined.components]


def _moved(joined: Joined, calibration: Calibration) -> Joined:
    """Maps where they go when their log is put right."""
    starts = (calibration.start_of(c.map).only(c.map.values.layout.keys) for c in joined.components)
    moved = (replace(c, map=replace(c.map, values=v)) for c, v in zip(joined.components, starts, strict=True))
    return replace(joined, components=tuple(moved))


def _carrying(joined: Joined, calibration: Calibration, log: Dataset) -> Joined:
    """Maps with the systematic errors of their measurements among their variables."""
    carried = (replace(c, map=calibration.carried_by_all(c.map, log.tables)) for c in joined.components)
    return replace(joined, components=tuple(carried))


def _log_in(given: Dataset | str | Path, config: Config) -> Dataset:
    """The log that is given, or lies there. InputError in words for anything else."""
    if isinstance(given, str | Path):
        return read(given, None, **config.read)
    if not isinstance(given, Dataset):
        raise InputError(f"expected a log (a Dataset, or the path of one), found {a_kind(given)}")
    return given


def _solved(
    log: Dataset, config: Config, workers: Workers | None, work: Path | None, clock: "Clock"
) -> tuple[list[Dataset], tuple[Submap, ...], Joined]:
    """The map, and what it was joined of: nothing for full least squares."""
    submaps: tuple[Submap, ...] = ()
    pieces: list[Dataset] = []
    if config.method == "full":
        clock.start("full least squares")
        joined = full(log, options=config.solver)
    elif workers is not None:
        pieces = _pieces(log, config)
        submaps, joined, unbuilt = _on_workers(pieces, workers, work, config.solver, clock)
        joined = _with_books(log, joined, unbuilt, ())
    elif config.join.exact:
        submaps, joined = _in_rounds(log, config, clock)
    else:
        pieces = _pieces(log, config)
        clock.start("building submaps", len(pieces))
        built = clock.each(_each(pieces, lambda piece: _build(piece, config.solver)))
        whole = _whole(built)
        submaps, remarks = tuple(submap for submap, _ in whole), [remark for _, remark in whole]
        clock.start("joining submaps")
        joined = ORDERS[config.join.order](submaps, options=config.solver)
        joined = _with_books(log, joined, built, [r for r in remarks if r])
    return pieces, submaps, joined


def refuse_workers(config: Config) -> None:
    """Raise InputError for options that workers cannot follow."""
    if config.method == "full" or config.join.exact:
        raise InputError("workers join submaps by a tree; full least squares and exact joins run in one process")
    if config.calibrate:
        raise InputError("workers take the noise as stated; leave out --calibrate (calibrate = true), or the workers")
    if config.join.order != "at once":
        raise InputError(f"workers join submaps by a tree of their own, not in the order '{config.join.order}'")


def scores_of(joined: Joined, covariances: Sequence[Covariances], truth: Values | None) -> tuple[Report, ...]:
    """Each component against the truth, each aligned by itself; nothing where no truth is known."""
    if truth is None:
        return ()
    both = zip(joined.components, covariances, strict=True)
    return tuple(score(component.map, truth, covariances=known) for component, known in both)


def _pieces(log: Dataset, config: Config) -> list[Dataset]:
    return split(log, poses_per_piece=config.split.poses_per_piece, heading_sigma=config.split.heading_sigma)


def pairs(pieces: Iterable[Dataset], submaps: Iterable[Submap]) -> list[tuple[Dataset, Submap]]:
    """Each piece with the submap that was built of it: the one whose sources are the piece's rows."""
    of_sources = {submap.sources: submap for submap in submaps}
    both = ((piece, of_sources.get(Sources.of(piece.tables))) for piece in pieces)
    return [(piece, submap) for piece, submap in both if submap is not None]


def _suspicions_of(log: Dataset, config: Config) -> Suspicions:
    """What is suspicious in a log, by its submaps and their join; what cannot be built is not looked at."""
    built = list(_each(_pieces(log, config), lambda piece: _build(piece, config.solver)))
    submaps, _ = zip(*_whole(built), strict=True)
    return suspicions(log, submaps)


def _in_rounds(log: Dataset, config: Config, clock: "Clock") -> tuple[tuple[Submap, ...], Joined]:
    """Submaps built and joined exactly, from the best that can be built of each piece."""
    pieces = _pieces(log, config)
    clock.start("building submaps", len(pieces))
    built = clock.each(_each(pieces, lambda piece: build_choices(piece, options=config.solver)))
    choices = _whole(built)
    clock.start("joining in rounds")
    joined = exact_join(
        [piece for piece, found in zip(pieces, built, strict=True) if not isinstance(found, Unbuilt)],
        choices=choices,
        gap=config.join.gap,
        max_rounds=config.join.max_rounds,
        options=config.solver,
        progress=lambda step: clock.tick(),
    )
    return tuple(found[0] for found in choices), _with_books(log, joined, built, ())


def _each(pieces: Sequence[Dataset], make: Callable[[Dataset], T]) -> Iterator[T | Unbuilt]:
    """What is made of each piece, or why nothing can be; long pieces several at a time."""

    def tried(piece: Dataset) -> T | Unbuilt:
        try:
            return make(piece)
        except SolveError as error:
            return Unbuilt(piece, str(error))

    long = any(sum(map(len, piece.tables)) > LONG for piece in pieces)
    return each_side_by_side(tried, pieces) if long else map(tried, pieces)


def _whole(built: Sequence[T | Unbuilt]) -> list[T]:
    """What could be made. Raises SolveError where nothing could."""
    made = [found for found in built if not isinstance(found, Unbuilt)]
    if not made and built:
        raise SolveError(next(lost.reason for lost in built if isinstance(lost, Unbuilt)))
    return made


def _build(piece: Dataset, options: Options) -> tuple[Submap, str]:
    """The submap of a piece, and what is to be remarked of it."""
    submap, solution = build_with_solution(piece, options=options)
    if solution.converged:
        return submap, ""
    return submap, f"submap {submap.id} stopped {solution.decrement:.2g} sigma from its optimum, and is used as it is"


def _with_books(log: Dataset, joined: Joined, built: Sequence[object], remarks: Sequence[str]) -> Joined:
    lost = [found for found in built if isinstance(found, Unbuilt)]
    return accounted(log, replace(joined, remarks=(*joined.remarks, *remarks)), lost)


def _on_workers(
    pieces: Sequence[Dataset], workers: Workers, work: Path | None, options: Options, clock: "Clock"
) -> tuple[tuple[Submap, ...], Joined, list[Unbuilt]]:
    """Submaps built and joined on workers; from the tree's estimate on, their join at once. And what was not built."""
    with nullcontext(work) if work else TemporaryDirectory(prefix="teamslam-") as folder:
        files = write_pieces(pieces, Path(folder) / "pieces")
        tree = join_in_tree(files, Path(folder), workers=workers, options=options, progress=clock.hear)
        clock.start("joining submaps")
        unbuilt = [Unbuilt(pieces[barren.number], barren.reason) for barren in tree.unbuilt]
        return tree.leaves(), gather(tree, options), unbuilt


class Clock:
    """Times the stages of a run and tells `progress` about them."""

    def __init__(self, progress: Progress | None) -> None:
        self._progress = progress or (lambda stage, done, of: None)
        self._seconds: dict[str, float] = {}
        self._stage, self._of, self._began = "", 0, time.perf_counter()
        self._done = 0

    def start(self, stage: str, of: int = 0) -> None:
        """End the stage before and start the next, of `of` parts (0: nobody knows)."""
        self.stop()
        self._stage, self._of, self._began = stage, of, time.perf_counter()
        self._done = 0
        self._progress(stage, 0, of)

    def tick(self) -> None:
        """One part of the stage more is done."""
        self._done += 1
        self._progress(self._stage, self._done, self._of)

    def hear(self, stage: str, done: int, of: int) -> None:
        """A stage that tells its own progress."""
        if stage != self._stage:
            self.start(stage, of)
        self._progress(stage, done, of)

    def each(self, parts: Iterable[T]) -> tuple[T, ...]:
        """All parts of a stage, told one by one."""
        done = []
        for part in parts:
            done.append(part)
            self.tick()
        return tuple(done)

    def stop(self) -> dict[str, float]:
        """End the last stage; the seconds of all."""
        if self._stage:
            self._seconds[self._stage] = time.perf_counter() - self._began
            self._progress(self._stage, self._of or 1, self._of or 1)
            self._stage = ""
        return dict(self._seconds)
