"""What holds of every record that a user can come to hold: short to print, whole after pickling and copying, frozen.

The records are found by going through all that runs, joins, submaps and answers hold, so that a new one is among them.
"""

import copy
import dataclasses
import pickle
from collections.abc import Callable, Iterator
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import scipy.sparse as sp

import teamslam as ts
from teamslam.cards import balance
from teamslam.kernel import Analysis, BlockPattern
from teamslam.results import Record, read_run
from teamslam.solver import Covariances
from teamslam.trust.fit import unknown
from worlds import mixed_team, team

LONGEST = 400
NOT_TOLD = ("made", "analysis")  # what makes a matrix, which the copy has made; what lives in the kernel
COPIES: dict[str, Callable[[Any], Any]] = {
    "pickle": lambda record: pickle.loads(pickle.dumps(record)),
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
}


def roots() -> Iterator[Any]:
    """Whatever the face hands out."""
    log = team("planar", poses=8)
    parts = [ts.build(piece) for piece in ts.split(log)]
    run = ts.run(log)
    exact = ts.run(log, ts.Config(join=dataclasses.replace(ts.Config().join, exact=True)))
    yield from (log, *parts, ts.join(parts), ts.full(log), run, exact, Record.of(run), ts.run(mixed_team()))
    yield from (run.trajectory("1"), run.landmarks, run.landmark("0"), run.covariance("0", "2@3"), run.residuals())
    yield from (run.relative("0", seen_from="2@3"), *run.residuals().worst(1), ts.Covariances.of_map(run.map))


def records_in(root: Any, seen: dict[int, Any]) -> None:
    """All records that can be reached from one, each once."""
    if id(root) in seen or isinstance(root, str | bytes | int | float | np.ndarray | sp.sparray | type) or root is None:
        return
    seen[id(root)] = root
    if isinstance(root, dict):
        inner = [*root.keys(), *root.values()]
    elif isinstance(root, list | tuple | set | frozenset):
        inner = list(root)
    elif dataclasses.is_dataclass(root) or isinstance(root, Covariances):
        inner = [value for name, value in vars(root).items() if not name.startswith("_")]
    else:
        return
    for value in inner:
        records_in(value, seen)


@pytest.fixture(scope="module")
def records() -> list[Any]:
    """One or a few of each kind."""
    seen: dict[int, Any] = {}
    for root in roots():
        records_in(root, seen)
    by_kind: dict[type, list[Any]] = {}
    for found in seen.values():
        ours = type(found).__module__.startswith("teamslam") and "kernel" not in type(found).__module__
        if ours and (dataclasses.is_dataclass(found) or isinstance(found, Covariances)):
            by_kind.setdefault(type(found), []).append(found)
    assert {"Dataset", "Submap", "Joined", "Result", "Verdict", "Report", "Solution"} <= {k.__name__ for k in by_kind}
    return [found for kind in by_kind.values() for found in kind[:: max(1, len(kind) // 6)]]


def test_every_record_prints_as_one_short_line(records: list[Any]) -> None:
    for found in records:
        assert len(repr(found)) < LONGEST and "\n" not in repr(found), (type(found), repr(found)[:500])
        assert "array(" not in repr(found), type(found)


@pytest.mark.parametrize("way", COPIES)
def test_every_record_is_whole_after_pickling_and_copying(records: list[Any], way: str) -> None:
    for found in records:
        again = COPIES[way](found)
        assert type(again) is type(found) and repr(again) == repr(found)
        assert same(found, again), type(found)


@pytest.mark.parametrize("way", COPIES)
def test_what_was_copied_still_answers(way: str) -> None:
    run = COPIES[way](ts.run(team("2d", poses=8)))
    assert run.covariance("0", "2@3").matrix == pytest.approx(ts.run(team("2d", poses=8)).covariance("0", "2@3").matrix)
    assert run.joined.components[0].solution.information.shape == (run.map.dof, run.map.dof)
    assert ts.join([run.map]).map.dof == run.map.dof and len(run.residuals()) > 0


@pytest.mark.parametrize("way", COPIES)
def test_what_lives_in_the_kernel_refuses_to_be_copied(way: str) -> None:
    """A second pointer to it would be read after the first has freed it."""
    with pytest.raises(TypeError, match="cannot be copied"):
        COPIES[way](Analysis(BlockPattern.from_pairs([2, 2], [0], [1])))


@pytest.mark.parametrize("way", ["as it is", *COPIES])
def test_frozen_means_frozen(records: list[Any], way: str) -> None:
    """No field can be set or deleted; estimates, poses, tables, maps and answers cannot be written into; nor copies."""
    sealed = (ts.Values, ts.Table, ts.Dataset, ts.Pose, type(ts.Values.of({}).layout))
    for found in map(COPIES.get(way, lambda record: record), records):
        if not dataclasses.is_dataclass(found):
            continue
        for field in dataclasses.fields(found):
            with pytest.raises(dataclasses.FrozenInstanceError):
                setattr(found, field.name, None)
            with pytest.raises(dataclasses.FrozenInstanceError):
                delattr(found, field.name)
            value = vars(found).get(field.name)
            if isinstance(value, np.ndarray) and (isinstance(found, sealed) or "answers" in type(found).__module__):
                assert not value.flags.writeable, (type(found), field.name)
            if isinstance(found, ts.Submap) and sp.issparse(getattr(found, field.name)):
                matrix = getattr(found, field.name)
                assert not any(part.flags.writeable for part in (matrix.data, matrix.indices, matrix.indptr))


@pytest.mark.parametrize("way", ["as it is", *COPIES])
def test_who_is_in_a_team_cannot_be_changed(way: str) -> None:
    log = COPIES.get(way, lambda record: record)(team("2d", poses=4))
    before = dict(log.robots)
    for change in (lambda d: d.update({9: 2}), lambda d: d.pop(1), lambda d: d.__setitem__(9, 3), lambda d: d.clear()):
        with pytest.raises(TypeError, match="frozen"):
            change(log.robots)
    assert log.robots == before and {**log.robots, 9: 2} == log.robots | {9: 2}


def test_making_a_record_does_not_freeze_what_it_was_made_of() -> None:
    state = np.zeros(3)
    values = ts.Values(ts.Values.of({}).layout, state[:0])
    state[0] = 1.0
    assert len(values) == 0 and state.flags.writeable


def test_cards_are_small_whole_markup_without_a_script_or_a_link(records: list[Any]) -> None:
    cards = {type(r).__name__: r._repr_html_() for r in records if hasattr(r, "_repr_html_")}
    whole = {"Dataset", "Submap", "Joined", "Covariances", "Values", "Report", "Result", "Verdict", "Record"}
    assert whole | {"Trajectory"} <= set(cards)
    for name, card in cards.items():
        ElementTree.fromstring(card)  # every tag is closed, every name escaped
        assert len(card) < 30_000, name
        assert "<script" not in card and "http://" not in card.replace("http://www.w3.org/2000/svg", "")
    for name in whole:
        assert "<svg" in cards[name], name
    assert "fits" in cards["Result"] or "fit" in cards["Result"]


def test_a_verdict_shows_which_sensor_is_off_and_one_that_is_none_says_why() -> None:
    """Bars to the right of the line are above what is expected, to the left below."""
    bars = ElementTree.fromstring(balance([("a", 100.0), ("<b>", 0.1), ("none", float("nan"))]))
    high, low = (float(bar.attrib["x"]) for bar in bars.iter("{http://www.w3.org/2000/svg}rect"))
    (line,) = bars.iter("{http://www.w3.org/2000/svg}line")
    assert low < float(line.attrib["x1"]) == high and balance([]) == ""
    assert "too few &lt;rows&gt;" in unknown("too few <rows>")._repr_html_()


def test_names_with_markup_are_words_on_cards() -> None:
    log = dataclasses.replace(team("2d", poses=6), names=ts.Dataset({}, ()).names, origin="<b>&")
    ElementTree.fromstring(log._repr_html_())
    assert "&lt;b&gt;&amp;" in log._repr_html_()


def test_a_card_of_a_long_log_is_as_small_as_that_of_a_short_one() -> None:
    log = ts.simulate("2d", robots=12, poses=1500, landmarks=300)
    assert len(log._repr_html_()) < 30_000 and len(log.truth._repr_html_()) < 60_000


@pytest.mark.parametrize(
    "noun", ["robots", "landmarks", "landmark", "trajectory", "covariance", "relative", "residuals", "map"]
)
def test_completion_offers_the_nouns(noun: str, tmp_path) -> None:
    run = ts.run(team("2d", poses=6))
    ts.write_run(run, tmp_path / "run", figures=False)
    for whole in (run, run.joined, read_run(tmp_path / "run")):
        offered = [name for name in dir(whole) if not name.startswith("_")]
        assert noun in offered or (noun == "map" and "maps" in offered)
    assert run.landmarks._ipython_key_completions_() == list(run.landmark_names)


def same(one: Any, other: Any) -> bool:
    """Whether two values hold the same numbers and words, however deep."""
    if isinstance(one, np.ndarray):
        return bool(np.array_equal(one, other, equal_nan=one.dtype.kind == "f"))
    if isinstance(one, sp.sparray):
        return one.shape == other.shape and bool(abs(one - other).max() == 0.0) if one.nnz else True
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[name], other[name]) for name in one)
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(same, one, other))
    if dataclasses.is_dataclass(one) and not isinstance(one, type):
        fields = [f.name for f in dataclasses.fields(one) if f.name not in NOT_TOLD]
        return type(one) is type(other) and all(same(getattr(one, name), getattr(other, name)) for name in fields)
    if isinstance(one, Covariances):
        return same(one.layout, other.layout) and same(one.all, other.all)
    plain = type(one).__eq__ is not object.__eq__  # what is told apart by being itself holds what is compared above
    return type(one) is type(other) and (not plain or one == other or one != one)
