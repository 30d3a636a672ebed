"""In what form submaps go: the first that is short enough, with all that others need kept, now and later."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from teamslam.fleet import fleet
from teamslam.joining import build, join, split
from teamslam.model import is_landmark, robot_of
from teamslam.results.fleet import bits_of, joined, links_of, report_of
from teamslam.robot import Options
from teamslam.robot.exchange import step
from teamslam.robot.forms import FORMS, VERSIONS, Order, allowance, made, needed
from teamslam.robot.line import Sent
from teamslam.robot.link.memory import Air, Weather
from teamslam.robot.opened import opened
from teamslam.robot.peer import Habits, Peer
from teamslam.solver import Covariances
from teamslam.team import Knowledge, SubmapSet
from teamslam.wire.messages import send
from teamslam.wire.rounding import EXACT
from worlds import team

ROBOTS = (1, 2)
PIECES = Options(poses_per_piece=15)
LOG = team("2d", robots=2, poses=45, landmarks=8, sees=0.3, every=9)
SUBMAPS = {robot: [build(piece) for piece in split(LOG.of_robot(robot), poses_per_piece=15)] for robot in ROBOTS}
WANTED = {r: needed(SUBMAPS[r], Peer(3 - r).with_submaps(SUBMAPS[3 - r]).known.beside(r)) for r in ROBOTS}
ORDERS = [Order(s, 0, WANTED[robot][s.id], np.inf) for robot in ROBOTS for s in SUBMAPS[robot]]


def sizes(order: Order) -> list[int]:
    return [len(send(form.kind, order.submap, order._kept(form), form.precision)) for form in FORMS]


@pytest.mark.parametrize("number", range(3))
def test_the_first_form_that_is_short_enough_goes(number: int) -> None:
    order = ORDERS[number]
    lengths = sizes(order)
    for most in (np.inf, *lengths, min(lengths) - 1):
        fit = [length for length in lengths if length <= most]
        assert len(replace(order, most=most).made()) == (fit[0] if fit else min(lengths))
    assert (
        order.made() == send("sparse", order.submap, order.submap.keys, EXACT).data
    )  # to the bit where nothing is tight


def test_what_others_need_is_in_every_form() -> None:
    for order in (ORDERS[0], ORDERS[-1]):
        for most in (np.inf, *sizes(order), 0.0):
            found = opened(replace(order, most=most).made())
            assert np.isin(order.needed, found.keys).all()
    for robot in ROBOTS:
        for first, second in zip(SUBMAPS[robot], SUBMAPS[robot][1:], strict=False):
            begins = second.first_pose  # where the next submap hangs on this one
            assert begins == first.base or begins in WANTED[robot][first.id]


def test_the_shortest_forms_make_the_map_of_the_whole_ones_within_their_rounding() -> None:
    whole = join(order.submap for order in ORDERS).map
    short = SubmapSet.of(*(replace(order, most=0.0).made() for order in ORDERS)).join().map
    both = np.intersect1d(whole.values.layout.keys, short.values.layout.keys)
    assert is_landmark(both).sum() >= 6 and len(short.values) < 0.6 * len(whole.values)
    off = short.values.only(both).minus(whole.values.only(both))
    joint = Covariances.of_map(whole).joint(both)
    # of each submap 0.03 sigma and 1 % of what it and the map disagree by, in quadrature
    assert np.sqrt(off @ np.linalg.solve(joint, off)) < 0.3
    np.testing.assert_allclose(Covariances.of_map(short).joint(both), joint, rtol=0.05, atol=0.02 * np.abs(joint).max())


def told(peers: dict[int, Peer], until: int = 60) -> dict[int, Peer]:
    air = Air(Weather(), 0)
    links = {robot: air.link(robot) for robot in peers}
    for tick in range(until):
        air.tick(float(tick))
        for robot, peer in peers.items():
            after, out = step(peer, float(tick), links[robot].receive())
            peers[robot] = after.with_submaps(())
            for packet in out:
                links[robot].send(packet.to, packet.data)
    return peers


def test_what_becomes_common_later_comes_in_a_new_version() -> None:
    """A robot that knows nobody sends what its own submaps need; then it hears that a landmark is known elsewhere."""
    alone = Peer(1, Habits(rate=1e-3)).with_submaps(SUBMAPS[1])
    first = {c.entry.id: c.opened.keys for c in alone.bodies.values() if not c.entry.knows}
    peers = told({1: alone, 2: Peer(2).with_submaps(SUBMAPS[2])})
    assert not peers[1].orders
    common = peers[1].known.beside(1)
    again = {c.entry.id: c for c in peers[1].bodies.values() if c.entry.id in first}
    for submap in SUBMAPS[1]:
        lacked = np.setdiff1d(np.intersect1d(submap.values.layout.keys, common), first[submap.id])
        assert np.isin(lacked, again[submap.id].opened.keys).all()
        assert again[submap.id].entry.version == (1 if len(lacked) else 0)
    assert any(content.entry.version for content in again.values())


def test_of_a_version_there_is_one_message_also_after_a_kill() -> None:
    peer = told({1: Peer(1, Habits(rate=1e-3)).with_submaps(SUBMAPS[1]), 2: Peer(2).with_submaps(SUBMAPS[2])})[1]
    again = Peer(1, Habits(rate=1e-3)).recalling(content.body for content in peer.bodies.values())
    again = again.with_submaps(SUBMAPS[1])
    assert again.root == peer.root and not again.orders
    newer = again.with_submaps([replace(SUBMAPS[1][0], version=1)])
    assert newer.held.held[SUBMAPS[1][0].id].version == VERSIONS


@settings(max_examples=3, deadline=None, phases=[Phase.explicit, Phase.reuse, Phase.generate])
@given(st.integers(0, 100), st.floats(0.0, 2.0), st.integers(6_500, 8_500))
def test_under_a_budget_in_which_whole_submaps_have_no_room_all_end_with_one_map(
    seed: int, most_s: float, budget: int
) -> None:
    assert sum(len(order.made()) for order in ORDERS[:3]) > budget
    found = fleet(LOG, PIECES, habits=Habits(budget=budget), weather=Weather(most_s=most_s), seed=seed)
    assert found.settled_s is not None
    assert len({bits_of(joined(member.peer.held)) for member in found.members.values()}) == 1
    assert len(joined(found.members[1].peer.held).components) == 1
    for link in links_of(found, LOG.names):
        assert sum(link["kinds"].values()) == link["body_bytes"] <= budget
        assert link["body_bytes"] + link["word_bytes"] == link["carried_bytes"]


def test_the_record_says_what_went_in_short() -> None:
    record, _ = report_of(LOG, fleet(LOG, PIECES, habits=Habits(budget=8_000)), PIECES)
    assert record["maps_equal"] and not record["equal_to_offline"] and record["in_short"] > 0
    assert {kind for link in record["links"] for kind in link["kinds"]} >= {"announcement"}
    whole, _ = report_of(LOG, fleet(LOG, PIECES), PIECES)
    assert whole["equal_to_offline"] and whole["in_short"] == 0
    assert all(set(link["kinds"]) == {"sparse", "announcement"} for link in whole["links"])


def test_an_allowance_is_a_share_of_what_is_left_and_of_the_rate() -> None:
    assert allowance(None, None, []) == np.inf
    assert allowance(1000, None, [100, 400]) == pytest.approx(60.0)
    assert allowance(1000, 5.0, []) == pytest.approx(50.0)
    assert allowance(1000, None, [2000]) == 0.0
    assert Sent().with_body("sparse", 5).with_body("sparse", 2).with_word(1).record()["kinds"] == {"sparse": 7}


def test_poses_of_others_and_what_they_named_are_needed() -> None:
    (first, *_) = SUBMAPS[1]
    keys = first.values.layout.keys
    others = keys[robot_of(keys) == 2]
    mine = keys[robot_of(keys) == 1]
    said = Knowledge().with_more(2, mine[1:2])
    assert len(others) and np.isin(others, needed([first], np.zeros(0, np.int64))[first.id]).all()
    assert mine[1] in needed([first], said.beside(1))[first.id]
    assert mine[1] not in needed([first], np.zeros(0, np.int64))[first.id]
    assert made([]) == []
