"""Teams over bad networks: real processes, real sockets, each robot in a network namespace of its own.

    python benchmarks/networks.py [--robots 4] [--poses 60] [--weathers calm loss delay narrow all] [--json FILE]

While they drive, and for some time after, pairs of robots are torn apart for a while, again and again; the last robot
comes late; the first leaves for good as soon as somebody else holds all that it made. In the end all that are left must
hold the same, and their maps be the offline join of all robots' rows, to the bit.

Needs network namespaces (as any user, or as root) and /dev/net/tun; ends with code 77 and the reason where there are
none. The weather is that of `tc netem` where the kernel has it (--by netem), else played by this process on IP packets
(--by ether): the sockets and their TCP are the kernel's in both.
"""

import argparse
import json
import signal
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from crew import STARTS_S, Crew, team_of
from ether import Ether, Weather, has_netem, in_a_namespace

WEATHERS = {
    "calm": Weather(),
    "loss": Weather(loss=0.3),
    "delay": Weather(delay_s=0.5),
    "narrow": Weather(rate=20e3),
    "all": Weather(loss=0.3, delay_s=0.5, rate=20e3),
}
PORT = 7447
PATIENCE_S = 600.0


def main() -> None:
    in_a_namespace()
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, default=4)
    parser.add_argument("--poses", type=int, default=60)
    parser.add_argument("--speed", type=float, default=1.0, help="a pose a second at 1")
    parser.add_argument("--weathers", nargs="+", choices=list(WEATHERS), default=list(WEATHERS))
    parser.add_argument("--by", choices=["netem", "ether"], help="who plays the weather")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path, help="write the numbers here too")
    options = parser.parse_args()
    netem = has_netem()
    if options.by == "netem" and not netem:
        sys.exit("this kernel has no netem (CONFIG_NET_SCH_NETEM)")
    options.netem = netem if options.by is None else options.by == "netem"
    rows = []
    print(
        "| weather | torn apart | hold the same after s | IP bytes | rounds ended after s | exact | ledger bytes "
        "| packets | IP bytes | maps equal | the offline join |\n|---|---|---|---|---|---|---|---|---|---|---|"
    )
    for name in options.weathers:
        rows.append(row := campaign(name, options))
        print(
            "| {weather} | {cuts} | {held_after_s} | {held_ip_bytes:,} | {rounded_after_s} | {exact} "
            "| {ledger_bytes:,} | {packets:,} | {ip_bytes:,} | {maps_equal} | {equal_to_offline} |".format(**row),
            flush=True,
        )
    if options.json:
        about = {"weather_by": "netem" if options.netem else "ether", "robots": options.robots, "poses": options.poses}
        options.json.write_text(json.dumps({**about, "rows": rows}, indent=1) + "\n")
    sys.exit(0 if all(row["maps_equal"] and row["equal_to_offline"] for row in rows) else 1)


def campaign(name: str, options: argparse.Namespace) -> dict[str, Any]:
    """One team in one weather."""
    log, robots = team_of(options.robots, options.poses, options.seed), list(range(1, options.robots + 1))
    rng = np.random.default_rng([options.seed, 3])
    places = {robot: f"{Ether.address(robot)}:{PORT}" for robot in robots}
    with (
        tempfile.TemporaryDirectory() as folder,
        Ether(robots, WEATHERS[name], options.seed, netem=options.netem) as ether,
        Crew(log, Path(folder), places, ether.inside, ("--speed", str(options.speed))) as crew,
    ):
        cuts = Cuts(rng, robots, ether)
        for robot in robots[:-1]:
            crew.start(robot)
        crew.until(lambda: all(crew.status(robot) for robot in crew.processes), STARTS_S)
        began, ends_s = time.monotonic(), options.poses / options.speed
        crew.until(lambda: cuts.now() or time.monotonic() - began > 0.3 * ends_s, PATIENCE_S)
        crew.start(robots[-1])  # late
        crew.until(lambda: cuts.now() or may_leave(crew, robots[0]), PATIENCE_S)
        crew.end(robots[0])
        crew.until(lambda: cuts.now() or all(crew.status(r).get("parked") for r in crew.processes), PATIENCE_S)
        parked = time.monotonic()
        crew.until(lambda: cuts.now() or time.monotonic() - parked > 10.0 / options.speed, 60.0)
        cuts.heal()
        held, held_s = crew.until(crew.held, PATIENCE_S), time.monotonic() - parked
        held_bytes = sum(ether.carried.values())
        ended, ended_s = crew.until(crew.rounded, PATIENCE_S), time.monotonic() - parked
        parts = [part for robot in crew.processes for part in crew.status(robot)["rounds"]["parts"]]
        codes = [crew.end(robot, signal.SIGTERM) for robot in list(crew.processes)]
        maps = crew.maps()
        left = {maps.get(robot) for robot in robots[1:]}
        return {
            "weather": name,
            "cuts": cuts.count,
            "held_after_s": round(held_s, 1) if held else None,
            "held_ip_bytes": held_bytes,
            "rounded_after_s": round(ended_s, 1) if ended else None,
            "exact": any(part["exactness"] for part in parts),
            "why": sorted({part["why"] for part in parts if part["why"]}),
            "exit_codes": codes,
            "said": [crew.said(robot) for robot in robots] if any(codes) else [],
            **ledger([crew.status(robot) for robot in robots]),
            "ip_bytes": sum(ether.carried.values()),
            "maps_equal": len(left) == 1 and None not in left,
            "equal_to_offline": left == {crew.offline_bits()},
        }


def ledger(statuses: list[dict[str, Any]]) -> dict[str, int]:
    """What robots say they sent, by the end of their last process: bytes and packets; what went to all, once for each
    other."""
    lines = [(name, line) for status in statuses for name, line in status["links"].items()]
    times = [len(statuses) - 1 if name == "all" else 1 for name, _ in lines]
    sums = {
        what: sum(n * sum(line[part] for part in parts) for n, (_, line) in zip(times, lines, strict=True))
        for what, parts in (("ledger_bytes", ("body_bytes", "word_bytes")), ("packets", ("bodies", "words")))
    }
    return sums


def may_leave(crew: Crew, robot: int) -> bool:
    """Whether a robot has no rows left, and some other holds all that it made."""
    said = crew.status(robot)
    own = {held for held in said.get("holds", ()) if held.startswith(f"{robot}/")}
    return bool(said.get("parked") and not said["making"] and own) and any(
        own <= set(crew.status(other).get("holds", ())) for other in crew.processes if other != robot
    )


class Cuts:
    """Pairs that are torn apart for a while, now and then one more: for 1 to 15 s."""

    def __init__(self, rng: np.random.Generator, robots: list[int], ether: Ether) -> None:
        self.count, self._rng, self._robots, self._ether = 0, rng, robots, ether
        self._until: dict[tuple[int, int], float] = {}
        self._next = time.monotonic() + 5.0

    def now(self) -> bool:
        """Tear and mend what is due; false, so that one can go on waiting."""
        now = time.monotonic()
        if now >= self._next:
            a, b = sorted(self._rng.choice(self._robots, 2, replace=False).tolist())
            self._until[a, b] = now + float(self._rng.uniform(1.0, 15.0))
            self.count, self._next = self.count + 1, now + float(self._rng.uniform(1.0, 5.0))
        self._ether.apart = {pair for pair, until in self._until.items() if until > now}
        return False

    def heal(self) -> None:
        """All reach each other again."""
        self._until, self._ether.apart = {}, set()


if __name__ == "__main__":
    main()
