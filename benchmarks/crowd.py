"""What exchange costs a robot as its team grows: bytes and time, over links in memory on one machine.

    python benchmarks/crowd.py [--teams 4 16 36 64 100] [--json FILE] [--figure FILE]

Every robot mows a cell of its own in one field, sees landmarks of the cells around it and robots that it meets, and
closes a submap every 25 poses (`growing_team`). Its peer then exchanges them, a step a quarter of a second, over links
that lose a tenth of all packets:

    all       robots of cells that touch reach each other, and through them everybody reaches everybody
    groups    the same field, but only the robots of a square of four reach each other: they never meet the others

The exchange ends when all that can reach each other hold the same. Bytes are those that a robot sent (words: all but
bodies), and those of bodies that it holds in the end; time is the processor's, of its peer's steps, without what
carries its packets; calls are those of functions in a step, counted in a run of their own: on a busy machine they tell
more.
"""

import argparse
import cProfile
import json
import statistics
import time
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from growing_team import Team
from run import machine
from teamslam.joining import build, split
from teamslam.model import Submap
from teamslam.robot.exchange import step
from teamslam.robot.link.memory import Air, Weather
from teamslam.robot.opened import opened
from teamslam.robot.peer import Peer

POSES, PIECE = 100, 25
TURN_S = 0.25
EVERY_S = 30.0  # between two submaps of a robot
PATIENCE_S = 3600.0
LINE = "| {robots} | {reach} | {words_kb:.1f} | {bodies_kb:.1f} | {holds_kb:.1f} | {ms:.0f} | {calls} | {settled_s} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--teams", type=int, nargs="+", default=[4, 16, 36, 64, 100])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path, help="write the numbers here too")
    parser.add_argument("--figure", type=Path, help="draw them here")
    options = parser.parse_args()
    print(
        f"{machine()}\n\n| robots | reach | words kB | bodies kB | holds kB | ms | calls | settled s |\n|{'---|' * 8}"
    )
    rows = []
    for robots in options.teams:
        field = Field(Team(robots, POSES, options.seed))
        submaps = field.submaps()
        for reach in ("all", "groups"):
            row = exchanged(field, submaps, reach)
            rows.append(row := row | {"calls": round(calls_a_turn(field, submaps, reach))})
            print(LINE.format(**row), flush=True)
    if options.json:
        options.json.write_text(json.dumps({"machine": machine(), "rows": rows}, indent=1) + "\n")
    if options.figure:
        draw(rows, options.figure)


@dataclass(frozen=True)
class Field:
    """A team's field: who is near whom."""

    team: Team

    def submaps(self) -> dict[int, list[Submap]]:
        """What each robot makes."""
        robots = range(1, self.team.robots + 1)
        return {n: [build(piece) for piece in split(self.team.log(n), poses_per_piece=PIECE)] for n in robots}

    def near(self, a: int, b: int, now_s: float) -> bool:
        """Whether two robots' cells touch."""
        return b in self.team.around(a)

    def group(self, robot: int) -> tuple[int, int]:
        """The square of four cells that a robot's is in."""
        row, column = divmod(robot - 1, self.team.columns)
        return row // 2, column // 2

    def grouped(self, a: int, b: int, now_s: float) -> bool:
        """Whether two robots are of one group."""
        return self.group(a) == self.group(b)


def calls_a_turn(field: Field, submaps: dict[int, list[Submap]], reach: str) -> float:
    """How many functions a robot calls in a turn: its work, whatever else the machine does."""
    opened.cache_clear()
    counted = cProfile.Profile()
    turns = exchanged(field, submaps, reach, counted)["turns"]
    return float(sum(call.callcount for call in counted.getstats()) / turns / len(submaps))


def exchanged(
    field: Field, submaps: dict[int, list[Submap]], reach: str, counted: AbstractContextManager[Any] | None = None
) -> dict[str, Any]:
    """A row: means over the robots. What their peers do is done within `counted`."""
    counted = counted or nullcontext()
    air = Air(Weather(loss=0.1, most_s=0.5), 0, field.near if reach == "all" else field.grouped)
    peers, links = {n: Peer(n) for n in submaps}, {n: air.link(n) for n in submaps}
    spent = dict.fromkeys(submaps, 0.0)
    last_s = EVERY_S * max(map(len, submaps.values()))
    turn, now_s = 0, 0.0
    while now_s < last_s + PATIENCE_S:
        turn, now_s = turn + 1, (turn + 1) * TURN_S
        air.tick(now_s)
        for robot, own in submaps.items():
            heard, began = links[robot].receive(), time.process_time()
            number, rest = divmod(turn - robot, round(EVERY_S / TURN_S))
            with counted:
                if not rest and 0 <= number < len(own):
                    peers[robot] = peers[robot].with_submaps([own[number]])
                peers[robot], out = step(peers[robot], now_s, heard)
            spent[robot] += time.process_time() - began
            for packet in out:
                links[robot].send(packet.to, packet.data)
        if now_s > last_s and rest_at_last(field, peers, reach):
            break
    sent = {n: [line.sent for line in peer.lines.values()] for n, peer in peers.items()}
    return {
        "robots": len(submaps),
        "reach": reach,
        "turns": turn,
        "words_kb": statistics.mean(sum(s.word_bytes for s in each) for each in sent.values()) / 1e3,
        "bodies_kb": statistics.mean(sum(s.body_bytes for s in each) for each in sent.values()) / 1e3,
        "holds_kb": statistics.mean(sum(len(c.data) for c in p.bodies.values()) for p in peers.values()) / 1e3,
        "ms": 1e3 * statistics.mean(spent.values()),
        "settled_s": round(now_s - last_s, 2) if rest_at_last(field, peers, reach) else None,
    }


def rest_at_last(field: Field, peers: dict[int, Peer], reach: str) -> bool:
    """Whether all that can reach each other hold the same."""
    roots: dict[object, set[bytes]] = {}
    for robot, peer in peers.items():
        roots.setdefault(None if reach == "all" else field.group(robot), set()).add(peer.root)
    return all(len(held) == 1 for held in roots.values())


def draw(rows: list[dict[str, Any]], path: Path) -> None:
    """Bytes and time a robot against the size of the team."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(1, 3, figsize=(10, 3), layout="constrained")
    for axis, (name, label) in zip(
        axes, [("bodies_kb", "bodies sent [kB]"), ("words_kb", "words sent [kB]"), ("ms", "time [ms]")], strict=True
    ):
        for reach in ("all", "groups"):
            of = [row for row in rows if row["reach"] == reach]
            axis.plot([row["robots"] for row in of], [row[name] for row in of], "o-", label=reach)
        axis.set(xlabel="robots in the team", ylabel=f"{label}, a robot", ylim=(0, None))
    axes[0].legend()
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    main()
