"""Packets that make no sense: a robot drives and talks while an intruder sends as many of them as it can.

    python benchmarks/fuzzed.py [--packets 100000] [--json FILE]

Packets are sound ones with bits turned, bytes cut off, put in or repeated, sound frames around random fields, submaps
whose seal fits and whose numbers do not, and noise; they come 100 to each of the robot's poses, in between those of a
real member, and the robot listens 25 times from one pose to the next (every 0.02 s, at two poses a second). Everything
that is not sound must be refused and counted, what the robot holds in the end must be what the real member said, and no
step may wait: a row that comes waits at most for one turn of talk, which is timed (the processor's
time) with the flood and without.
"""

import argparse
import gc
import json
import statistics
import sys
import time
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from crew import PIECE, team_of
from run import machine
from teamslam.convoy import HEARD_AT_ONCE
from teamslam.errors import TeamslamError
from teamslam.joining import build, split
from teamslam.live import replayed
from teamslam.model import Dataset
from teamslam.robot import Options, Robot
from teamslam.robot.exchange import step
from teamslam.robot.link.memory import Air, Weather
from teamslam.robot.opened import opened
from teamslam.robot.packets import Ask, Body, Entry, Have, List, Want, from_bytes, to_bytes
from teamslam.robot.peer import Peer
from teamslam.wire.messages import DIGEST as SEAL
from teamslam.wire.messages import _digest

EACH, TURNS = 100, 25  # packets for each pose, and turns of talk in which they are heard
INTRUDER = 3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--packets", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path, help="write the numbers here too")
    options = parser.parse_args()
    log = team_of(2, max(60, options.packets // EACH), options.seed)
    calm, flooded = (driven(log, packets, options.seed) for packets in (0, options.packets))
    print(f"{machine()}\n\n| | sent | not sound | refused | shut out | step ms: median, p99, max | talk ms |")
    print("|---|---|---|---|---|---|---|")
    for row in (calm, flooded):
        print("| {what} | {sent:,} | {unsound:,} | {refused:,} | {shut_out:,} | {step_ms} | {talk_ms} |".format(**row))
    unharmed = flooded["holds"] == calm["holds"]
    print(f"\nwhat it holds is {'the same' if unharmed else 'NOT THE SAME'}; every packet is accounted for: "
          f"{flooded['accounted']}")  # fmt: skip
    if options.json:
        rows = [{k: v for k, v in row.items() if k != "holds"} for row in (calm, flooded)]
        options.json.write_text(json.dumps({"machine": machine(), "rows": rows, "unharmed": unharmed}, indent=1) + "\n")
    sys.exit(0 if unharmed and flooded["accounted"] else 1)


def driven(log: Dataset, packets: int, seed: int) -> dict[str, Any]:
    """A row: robot 1 drives, robot 2 has submaps for it, and the intruder sends so many packets."""
    rng = np.random.default_rng(seed)
    theirs = [build(piece) for piece in split(log.of_robot(2), poses_per_piece=PIECE)][:5]
    air = Air(Weather(), seed)
    links = {robot: air.link(robot) for robot in (1, 2, INTRUDER)}
    peer, other = Peer(1), Peer(2).with_submaps(theirs)
    robot = Robot.of(log, 1, Options(poses_per_piece=PIECE))
    sound_ones = [to_bytes(p) for p in _sound(other)]
    steps, talks, sent, unsound, now_s = [], [], 0, 0, 0.0
    gc.disable()
    for _, tables in replayed(log, 1):
        now_s += 0.5
        for _ in range(min(EACH, packets - sent)):
            data = fuzzed(rng, sound_ones)
            unsound += not is_sound(data)
            links[INTRUDER].send(1, data)
            sent += 1
        other, out = step(other, now_s, links[2].receive())
        for packet in out:
            links[2].send(packet.to, packet.data)
        air.tick(now_s)
        for turn in range(TURNS):
            began = time.thread_time()
            peer, out = step(peer, now_s + 0.02 * turn, links[1].receive(HEARD_AT_ONCE))
            talks.append(1e3 * (time.thread_time() - began))
            for packet in out:
                links[1].send(packet.to, packet.data)
        began = time.thread_time()
        robot = robot.step(tables)
        if robot.due:
            robot = robot.close()
        steps.append(1e3 * (time.thread_time() - began))
        if not now_s % 25:
            gc.collect()
    for _ in range(TURNS):
        peer, _ = step(peer, now_s, links[1].receive())
    refused, shut_out = sum(peer.refused.values()), links[1].inbox.dropped[INTRUDER]
    return {
        "what": "flooded" if packets else "calm",
        "sent": sent, "unsound": unsound, "refused": refused, "shut_out": shut_out,
        "reasons": len(peer.refused),
        "step_ms": spread(steps), "talk_ms": spread(talks),
        "holds": sorted((s.id, s.version) for s in peer.held.submaps),
        "accounted": unsound - shut_out <= refused <= unsound,
    }  # fmt: skip


def _sound(peer: Peer) -> list[Any]:
    bodies = [Body(content.data) for content in peer.bodies.values()]
    return [Have(peer.root), Ask(), peer.listing, Want(tuple(peer.bodies)), *bodies]


def fuzzed(rng: np.random.Generator, sound: list[bytes]) -> bytes:
    """A packet that is nearly one."""
    data = bytearray(sound[int(rng.integers(len(sound)))])
    at = int(rng.integers(len(data)))
    match int(rng.integers(8)):
        case 0:
            return rng.bytes(int(rng.integers(200)))
        case 1:
            data[at] ^= 1 << int(rng.integers(8))
        case 2:
            del data[at:]
        case 3:
            data[at:at] = rng.bytes(int(rng.integers(1, 9)))
        case 4:
            return bytes(data) * 2
        case 5:  # a frame of a packet around fields of chance
            tag = ["have", "ask", "list", "want", "body"][int(rng.integers(5))]
            fields = [_field(rng) for _ in range(int(rng.integers(4)))]
            return msgspec.msgpack.encode([tag, *fields])
        case 6:  # things that nobody has, in great number
            names = [rng.bytes(16) for _ in range(int(rng.integers(50)))]
            entries = tuple(Entry(f"{n.hex()[:6]}", 1 << 40, n, 1 << 60, 1 << 60) for n in names)
            return to_bytes([List(entries), Want(tuple(names))][int(rng.integers(2))])
        case _:  # a submap of which some bytes are others, sealed again
            inner = from_bytes(sound[-1])
            assert isinstance(inner, Body)
            plain = bytearray(inner.data)
            plain[int(rng.integers(5 + SEAL, len(plain)))] ^= 1 << int(rng.integers(8))
            plain[5 : 5 + SEAL] = _digest(bytes(plain[:5] + plain[5 + SEAL :]), SEAL)
            packet = to_bytes(Body(bytes(plain)))
            return b"" if is_sound(packet) else packet  # a forgery, not a fault: for signatures to find
    return bytes(data)


def _field(rng: np.random.Generator) -> Any:
    return [
        int(rng.integers(-(1 << 40), 1 << 40)), rng.bytes(16), "x" * int(rng.integers(400)), None, [], -1.5,
        [[rng.bytes(3).hex(), int(rng.integers(100)), rng.bytes(16), 1, 1]], [rng.bytes(16)], {"a": 1},
    ][int(rng.integers(9))]  # fmt: skip


def is_sound(data: bytes) -> bool:
    """Whether a robot must take a packet: it is one, and a body in it is a submap."""
    try:
        packet = from_bytes(data)
        if isinstance(packet, Body):
            opened(packet.data)
    except TeamslamError:
        return False
    return True


def spread(times: list[float]) -> str:
    """Median, 99th percentile and largest."""
    return f"{statistics.median(times):.2f}, {float(np.percentile(times, 99)):.2f}, {max(times):.2f}"


if __name__ == "__main__":
    main()
