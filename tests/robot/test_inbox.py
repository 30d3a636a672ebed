"""What waits to be heard: bounded for each sender, and fair."""

from hypothesis import given
from hypothesis import strategies as st

from teamslam.robot.link.inbox import PACKETS, Inbox

NOISE, LARGE, MEMBERS = (
    10_000,
    16 << 20,
    4096,
)  # more packets, bytes and senders than may wait; said here, so that this ends


@given(st.lists(st.tuples(st.integers(1, 4), st.binary(max_size=3)), max_size=60), st.integers(1, 7))
def test_each_senders_packets_come_in_order_and_none_is_passed_over(
    packets: list[tuple[int, bytes]], most: int
) -> None:
    inbox = Inbox()
    for sender, data in packets:
        inbox.put(sender, data)
    turns = []
    while turn := inbox.take(most):
        turns.append(turn)
    taken = [packet for turn in turns for packet in turn]
    for one in range(1, 5):
        assert [data for sender, data in taken if sender == one] == [data for sender, data in packets if sender == one]
    assert all(len(turn) == most for turn in turns[:-1]) and not inbox.dropped
    # While several wait, they are heard in turns: nobody is heard twice before another who waits is heard once.
    senders = [sender for sender, _ in taken]
    for at, sender in enumerate(senders):
        waits = set(senders[at:]) - {sender}
        until = next((n for n in range(at + 1, len(senders)) if senders[n] == sender), len(senders))
        assert until == len(senders) or waits <= set(senders[at:until])


def test_who_shouts_is_shut_out_alone_and_counted() -> None:
    inbox = Inbox()
    for _ in range(NOISE):
        inbox.put(1, b"noise")
    inbox.put(2, b"word")
    assert inbox.dropped == {1: NOISE - PACKETS} and (2, b"word") in inbox.take(2)


def test_large_packets_are_bounded_together_and_one_may_be_larger_alone() -> None:
    inbox = Inbox()
    large = bytes(LARGE + 1)
    inbox.put(1, large)
    inbox.put(1, b"more")
    assert inbox.dropped == {1: 1} and len(inbox.take(9)) == 1
    inbox.put(1, b"more")
    assert inbox.take(9) == [(1, b"more")]


def test_what_waits_is_bounded() -> None:
    """Whoever says whatever: a robot's memory is."""
    inbox = Inbox()
    for sender in range(2 * MEMBERS):
        inbox.put(sender, b"here I am")
    assert inbox.dropped.total() > 0 and len(inbox.take(2 * MEMBERS)) <= MEMBERS
