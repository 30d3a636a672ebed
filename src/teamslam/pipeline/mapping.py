"""The map of a log: submaps and their join, an exact join in rounds, a tree on workers, or full least squares.

What cannot be built or joined ends nothing: it is left out, and stands in the account.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeVar

import numpy as np

from teamslam.config import Config
from teamslam.errors import InputError, SolveError
from teamslam.geometry import IntArray
from teamslam.joining import (
    ORDERS,
    Joined,
    Unbuilt,
    accounted,
    build_choices,
    build_with_solution,
    exact_join,
    from_map,
    full,
    join,
    split,
)
from teamslam.joining.exact.gap import frame_of, point_of
from teamslam.joining.join.bystanders import Bystander
from teamslam.joining.join.join import Component
from teamslam.joining.join.sides import sides
from teamslam.model import Dataset, Sources, Submap, Values, told_by
from teamslam.pipeline.clock import Clock
from teamslam.scale import Workers, gather, join_in_tree
from teamslam.solver import Options, each_side_by_side
from teamslam.wire.pieces import write_pieces

T = TypeVar("T")

LONG = 5000  # rows of a piece from which on its computing outweighs the Python around it


def mapped(
    log: Dataset,
    config: Config,
    workers: Workers | None,
    work: Path | None,
    clock: Clock,
    near: Joined | None = None,
    lain: bool = False,
) -> tuple[list[Dataset], tuple[Submap, ...], Joined]:
    """The pieces of a log, their submaps and the map that these join to; for full least squares the map alone. `near`:
    a map of the same log that is known, from which all of them start (workers begin from their own), submaps at once as
    they have `lain` there."""
    submaps: tuple[Submap, ...] = ()
    pieces: list[Dataset] = []
    if config.method == "full":
        clock.start("full least squares")
        joined = full(log, initial=near if near is not None and _has_all(near, log) else None, options=config.solver)
    elif workers is not None:
        pieces = pieces_of(log, config)
        submaps, joined, unbuilt = _on_workers(pieces, workers, work, config.solver, clock)
        joined = with_books(log, joined, unbuilt, ())
    elif config.join.exact:
        submaps, joined = _in_rounds(log, config, clock, near, lain)
    else:
        pieces = pieces_of(log, config)
        clock.start("building submaps", len(pieces))
        built = clock.each(_each(pieces, lambda piece: _build(piece, config.solver, near)))
        whole = whole_of(built)
        submaps, remarks = tuple(submap for submap, _ in whole), [remark for _, remark in whole]
        clock.start("joining submaps")
        if lain and config.join.order == "at once":
            joined = join(submaps, near=near, options=config.solver)
        else:
            joined = ORDERS[config.join.order](submaps, options=config.solver)
        joined = with_books(log, joined, built, [r for r in remarks if r])
    return pieces, submaps, joined


def on_their_sides(log: Dataset, joined: Joined) -> tuple[Joined | None, tuple[str, ...]]:
    """Maps with robots that ranges alone tie to the rest on the side of it where they cost least, None where they are
    there; and what fits on the other side as well, in words (see `sides`)."""
    lowers, words = list[Values | None](), list[str]()
    for map in joined.maps:
        there = point_of(map)
        lower, near = sides(there, told_by(log.tables, there.layout), frame_of(map))
        lowers.append(lower)
        words += [mirrored.sentence(log.names) for mirrored in near]
    if all(lower is None for lower in lowers):
        return None, tuple(words)
    both = zip(joined.components, lowers, strict=True)
    return replace(joined, components=tuple(c if v is None else _there(c, v) for c, v in both)), tuple(words)


def _there(component: Component, lower: Values) -> Component:
    """A component whose map is where it costs less."""
    map = component.map
    values = map.values.update(lower.only(_both(map.values, lower)))
    return replace(component, map=replace(map, values=values))


def _both(one: Values, other: Values) -> IntArray:
    return np.intersect1d(one.layout.keys, other.layout.keys)


def _has_all(joined: Joined, log: Dataset) -> bool:
    """Whether everything that a log names is in one of the maps."""
    return bool(np.isin(log.layout.keys, np.concatenate([submap.keys for submap in joined.maps])).all())


def refuse_workers(config: Config, *, calibrate: bool = False) -> None:
    """Raise InputError for options that workers cannot follow; to `calibrate` is one where it is asked for in words."""
    if config.method == "full" or config.join.exact:
        raise InputError("workers join submaps by a tree; full least squares and exact joins run in one process")
    if calibrate:
        raise InputError("workers take the noise as it is stated; leave out --calibrate, or the workers")
    if config.join.order != "at once":
        raise InputError(f"workers join submaps by a tree of their own, not in the order '{config.join.order}'")


def in_rounds(config: Config) -> Config:
    """The options of a run that joins exactly and is alike in all else."""
    return replace(config, join=replace(config.join, order="at once", exact=True))


def pieces_of(log: Dataset, config: Config) -> list[Dataset]:
    return split(log, poses_per_piece=config.split.poses_per_piece, heading_sigma=config.split.heading_sigma)


def pairs(pieces: Iterable[Dataset], submaps: Iterable[Submap]) -> list[tuple[Dataset, Submap]]:
    """Each piece with the submap that was built of it: the one whose sources are the piece's rows."""
    of_sources = {submap.sources: submap for submap in submaps}
    both = ((piece, of_sources.get(Sources.of(piece.tables))) for piece in pieces)
    return [(piece, submap) for piece, submap in both if submap is not None]


def submaps_of(log: Dataset, config: Config) -> list[Submap]:
    """The submaps of a log; what cannot be built is not among them. Raises SolveError where nothing can be."""
    built = list(_each(pieces_of(log, config), lambda piece: _build(piece, config.solver)))
    return [submap for submap, _ in whole_of(built)]


def _in_rounds(
    log: Dataset, config: Config, clock: Clock, near: Joined | None, lain: bool
) -> tuple[tuple[Submap, ...], Joined]:
    """Submaps built and joined exactly, from the best that can be built of each piece."""
    pieces = pieces_of(log, config)
    clock.start("building submaps", len(pieces))
    built = clock.each(_each(pieces, lambda piece: _choices(piece, config.solver, near)))
    choices = whole_of(built)
    clock.start("joining in rounds")
    joined = exact_join(
        [piece for piece, found in zip(pieces, built, strict=True) if not isinstance(found, Unbuilt)],
        choices=choices,
        near=near if lain else None,
        gap=config.join.gap,
        max_rounds=config.join.max_rounds,
        options=config.solver,
        progress=lambda step: clock.tick(),
    )
    return tuple(found[0] for found in choices), with_books(log, joined, built, ())


def _on_workers(
    pieces: Sequence[Dataset], workers: Workers, work: Path | None, options: Options, clock: Clock
) -> tuple[tuple[Submap, ...], Joined, list[Unbuilt]]:
    """Submaps built and joined on workers; from the tree's estimate on, their join at once. And what was not built."""
    with nullcontext(work) if work else TemporaryDirectory(prefix="teamslam-") as folder:
        files = write_pieces(pieces, Path(folder) / "pieces")
        tree = join_in_tree(files, Path(folder), workers=workers, options=options, progress=clock.hear)
        clock.start("joining submaps")
        unbuilt = [Unbuilt(pieces[barren.number], barren.reason) for barren in tree.unbuilt]
        return tree.leaves(), gather(tree, options), unbuilt


def _each(pieces: Sequence[Dataset], make: Callable[[Dataset], T]) -> Iterator[T | Unbuilt]:
    """What is made of each piece, or why nothing can be; long pieces several at a time."""

    def tried(piece: Dataset) -> T | Unbuilt:
        try:
            return make(piece)
        except SolveError as error:
            return Unbuilt(piece, str(error))

    long = any(sum(map(len, piece.tables)) > LONG for piece in pieces)
    return each_side_by_side(tried, pieces) if long else map(tried, pieces)


def whole_of(built: Sequence[T | Unbuilt]) -> list[T]:
    """What could be made. Raises SolveError where nothing could."""
    made = [found for found in built if not isinstance(found, Unbuilt)]
    if not made and built:
        raise SolveError(next(lost.reason for lost in built if isinstance(lost, Unbuilt)))
    return made


def _choices(piece: Dataset, options: Options, near: Joined | None) -> list[Submap]:
    """The submaps of a piece to start from: that which the map leads to that is known, else all that it may be."""
    start = None if near is None else from_map(piece, near.maps)
    if start is None:
        return build_choices(piece, options=options)
    return [build_with_solution(piece, options=options, near=start)[0]]


def _build(piece: Dataset, options: Options, near: Joined | None = None) -> tuple[Submap, str]:
    """The submap of a piece, and what is to be remarked of it."""
    return build_from(None if near is None else from_map(piece, near.maps), piece, options)


def build_from(start: Values | None, piece: Dataset, options: Options) -> tuple[Submap, str]:
    """The submap of a piece from a start, where there is one, and what is to be remarked of it."""
    submap, solution = build_with_solution(piece, options=options, near=start)
    if solution.converged:
        return submap, ""
    return submap, f"submap {submap.id} stopped {solution.decrement:.2g} sigma from its optimum, and is used as it is"


def with_books(
    log: Dataset,
    joined: Joined,
    built: Sequence[object],
    remarks: Sequence[str],
    stood_by: Sequence[Bystander] = (),
) -> Joined:
    """A map of a log with its books, where some of what was `built` is `Unbuilt`, and with what was remarked of it;
    and some poses `stood_by` already."""
    lost = [found for found in built if isinstance(found, Unbuilt)]
    return accounted(log, replace(joined, remarks=(*joined.remarks, *remarks)), lost, stood_by)
