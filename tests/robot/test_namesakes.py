"""What a robot hears under its own ids: from before, when its journal is gone, or of another robot of its number."""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from dataclasses import replace
from typing import Any

import pytest

from teamslam.joining import build, separators, split
from teamslam.model import Submap
from teamslam.robot.exchange import step
from teamslam.robot.forms import FORMS, VERSIONS, Form
from teamslam.robot.link.memory import Air, Weather
from teamslam.robot.namesakes import tells
from teamslam.robot.peer import Habits, Peer
from teamslam.robot.scribe import Scribe
from teamslam.wire.messages import send
from worlds import team


def submaps(seed: int) -> list[Submap]:
    log = team("2d", robots=2, poses=24, landmarks=6, sees=0.6, seed=seed)
    return [build(piece) for piece in split(log.of_robot(1), poses_per_piece=9)]


ONE, OTHER = submaps(0), submaps(1)  # the same ids, of other rows
SHORT = 50.0  # bytes a second: submaps go in short


def talked(peers: Sequence[Peer], seconds: int, first_s: int = 0) -> list[Peer]:
    """Peers that all reach each other, for a while; on the air they go by their places, so that two may be of one
    number."""
    found, air = list(peers), Air(Weather(), 0)
    links = [air.link(n) for n in range(1, len(found) + 1)]
    for tick in range(first_s, first_s + seconds):
        air.tick(float(tick))
        for n, link in enumerate(links):
            found[n], out = step(found[n], float(tick), link.receive())
            found[n] = found[n].with_submaps(())
            for packet in out:
                link.send(packet.to, packet.data)
    return found


@pytest.mark.parametrize(
    ("first", "second", "rate"),
    [(0, 0, None), (0, len(OTHER), None), (len(ONE), len(OTHER), None), (2, 1, None), (0, len(OTHER), SHORT)],
)
def test_whoever_is_heard_first_all_hold_the_same_and_it_is_said(first: int, second: int, rate: float | None) -> None:
    """Two robots of one number make their submaps before and after they hear each other: both contents of each id are
    held by all in the end, none is in a map, and the two say that it is theirs."""
    habits = Habits(rate=rate)
    peers = [Peer(1, habits).with_submaps(ONE[:first]), Peer(1, habits).with_submaps(OTHER[:second]), Peer(2)]
    peers = talked(peers, 30)
    peers = talked([peers[0].with_submaps(ONE), peers[1].with_submaps(OTHER), peers[2]], 60, 30)
    assert len({peer.root for peer in peers}) == 1
    for submap in ONE:
        assert len(peers[2].held.held[submap.id].contents) == 2
        assert all("of another robot of its number" in peer.left_out[submap.id] for peer in peers[:2])
        assert "different submaps are all called" in peers[2].left_out[submap.id]
    assert not peers[2].held.submaps


@pytest.mark.parametrize("rate", [None, SHORT])
def test_what_it_made_before_is_its_own_though_it_hears_it_of_others(rate: float | None) -> None:
    """Its journal is gone, its rows came again, and now its lines are ample: one message of each version stays."""
    before = talked([Peer(1, Habits(rate=rate)).with_submaps(ONE), Peer(2)], 40)
    again = talked([Peer(1), before[1]], 12, 40)
    after = talked([again[0].with_submaps(ONE), again[1]], 12, 52)
    assert after[0].root == after[1].root == before[1].root and not after[0].left_out
    assert not after[0].unmade


@pytest.mark.parametrize(("then", "now"), [(SHORT, None), (None, SHORT)])
def test_what_it_makes_again_in_another_form_before_it_hears_of_it_is_one_submap(
    then: float | None, now: float | None
) -> None:
    """Both forms tell the same rows, so neither is wrong: one version more takes the place of both, for all who hold
    them, also where it was ended and started in between."""
    before = talked([Peer(1, Habits(rate=then)).with_submaps(ONE), Peer(2)], 40)
    again = Peer(1, Habits(rate=now)).with_submaps(ONE)
    assert again.root != before[1].root
    torn = talked([again, before[1]], 4, 40)
    resumed = Peer(1, Habits(rate=now)).recalling(c.body for c in torn[0].bodies.values()).with_submaps(ONE)
    for peers in (torn, [resumed, torn[1]]):
        after = talked(peers, 60, 44)
        assert after[0].root == after[1].root and not after[0].left_out and not after[0].unmade
        assert {s.id for s in after[1].held.submaps} == {s.id for s in ONE}
        assert all(len(held.contents) == 1 for held in after[1].held.held.values())


def test_two_robots_that_make_the_same_in_two_forms_do_not_outbid_each_other_for_ever() -> None:
    peers = [Peer(1).with_submaps(ONE), Peer(1, Habits(rate=SHORT)).with_submaps(ONE), Peer(2)]
    after = talked(peers, 400)
    assert len({peer.root for peer in after}) == 1 and not any(peer.unmade for peer in after)


class Later(Executor):
    """Calls a function when it is told to."""

    def __init__(self) -> None:
        self.calls: list[Callable[[], None]] = []

    def submit(self, fn: Callable[..., Any], /, *args: Any, **_: Any) -> Future[Any]:
        future: Future[Any] = Future()
        self.calls.append(lambda: future.set_result(fn(*args)))
        return future


@pytest.mark.parametrize("made", [0, 1, len(ONE)])
def test_who_goes_on_from_its_journal_comes_to_rest_once_it_knows_what_is_its_own(made: int) -> None:
    """Also where all is there already, and what it learns is no more than that."""
    before = Peer(1).with_submaps(ONE[:made])
    peer = Peer(1).recalling(c.body for c in before.bodies.values()).owning(ONE)
    scribe, later = Scribe(executor := Later()), 0
    peer = scribe.attend(peer)
    assert scribe.busy(peer)
    while later < len(executor.calls):
        executor.calls[later]()
        peer, later = scribe.attend(peer), later + 1
    assert not scribe.busy(peer) and not peer.unmade and later == 1


def test_what_is_held_in_a_newer_version_is_said() -> None:
    """A former life had late rows: its version stays, whoever is heard first; what this one mapped is in no map."""
    newer = replace(OTHER[0], version=1)
    for hears_first in (True, False):
        peer = Peer(1) if hears_first else Peer(1).with_submaps(ONE)
        peer = talked([peer, Peer(1).with_submaps([newer])], 12)[0].with_submaps(ONE)
        assert peer.held.held[ONE[0].id].version == VERSIONS and len(peer.held.held[ONE[0].id].contents) == 1
        assert set(peer.left_out) == {ONE[0].id} and f"held in version {VERSIONS}" in peer.left_out[ONE[0].id]
    own = Peer(1).with_submaps([replace(ONE[0], version=1)])
    assert not own.left_out


@pytest.mark.parametrize("form", FORMS)
def test_a_message_tells_its_submap_in_every_form_and_no_other(form: Form) -> None:
    for mine, other in zip(ONE, OTHER, strict=True):
        keep = separators(ONE, landmarks=True)[mine.id]
        data = send(form.kind, mine, keep, form.precision).data
        assert tells(data, mine) and not tells(data, other)
        assert not tells(data, replace(mine, sources=mine.sources.merge(ONE[0].sources, ONE[-1].sources)))
