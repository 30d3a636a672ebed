"""The robots of a log in processes of their own (`teamslam robot`), to be started, stopped and killed by a campaign."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from teamslam.io import read, read_submaps, write
from teamslam.model import Dataset
from teamslam.results.fleet import bits_of, bits_of_parts, joined, offline_submaps
from teamslam.robot import Options
from teamslam.robot.link.keys import make_certificates
from teamslam.sim.scenario import Options as World
from teamslam.sim.scenario import simulate_options
from teamslam.team import SubmapSet

PIECE = 12  # poses of a submap
STARTS_S = 90.0  # a process is there by then


def team_of(robots: int, poses: int, seed: int) -> Dataset:
    """A made-up team in the plane, that sees landmarks and each other."""
    return simulate_options(World("2d", robots, poses, 8 + 2 * robots), seed)


def nowhere(robot: int) -> list[str]:
    """A robot runs where this process does."""
    return []


@dataclass
class Crew:
    """Robots by number: their `places` (host:port), what to write before their commands, and their processes."""

    log: Dataset
    folder: Path
    places: dict[int, str]
    inside: Callable[[int], Sequence[str]] = nowhere
    extra: Sequence[str] = ()
    processes: dict[int, "subprocess.Popen[bytes]"] = field(default_factory=dict)

    def __post_init__(self) -> None:
        write(self.log, self.folder / "log", "plain")
        hosts = sorted({place.partition(":")[0] for place in self.places.values()})
        make_certificates(self.folder / "secrets", self.places, hosts)

    def __enter__(self) -> "Crew":
        return self

    def __exit__(self, *_: object) -> None:
        for robot in list(self.processes):
            self.end(robot, signal.SIGKILL)

    def start(self, robot: int) -> None:
        """Start a robot; it goes on from its journal where there is one."""
        home = self.folder / str(robot)
        home.mkdir(exist_ok=True)
        (home / "status.json").unlink(missing_ok=True)  # what it said before it was killed
        command = [*self.inside(robot), sys.executable, "-m", "teamslam", "robot", str(self.folder / "log")]
        command += ["--robot", str(robot), "--out", str(home), "--resume", "--poses-per-piece", str(PIECE)]
        command += ["--listen", self.places[robot], "--certificates", str(self.folder / "secrets"), *self.extra]
        command += ["--connect", *(place for other, place in self.places.items() if other != robot)]
        command += ["--members", *map(str, self.places)]
        with (home / "output.txt").open("ab") as output:
            env = {**os.environ, "OMP_NUM_THREADS": "1"}
            self.processes[robot] = subprocess.Popen(command, stdout=output, stderr=output, env=env)

    def end(self, robot: int, how: signal.Signals = signal.SIGTERM) -> int:
        """End a robot, and its exit code. After SIGTERM it writes its map."""
        process = self.processes.pop(robot)
        process.send_signal(how)
        return process.wait(120.0)

    def status(self, robot: int) -> dict[str, Any]:
        """What a robot last said of itself; nothing where it said nothing yet."""
        try:
            found: dict[str, Any] = json.loads((self.folder / str(robot) / "status.json").read_text())
            return found
        except (OSError, ValueError):
            return {}

    def said(self, robot: int) -> str:
        """The end of what a robot wrote on its terminal."""
        return (self.folder / str(robot) / "output.txt").read_text()[-2000:]

    def held(self) -> bool:
        """Whether all that run have no rows left, nothing to make, and hold the same."""
        said = [self.status(robot) for robot in self.processes]
        return all(s.get("parked") and not s["making"] for s in said) and len({s["root"] for s in said}) == 1

    def same(self) -> bool:
        """Whether they have nothing to ask in exact rounds, either."""
        return self.held() and not any(self.status(robot)["rounds"]["busy"] for robot in self.processes)

    def rounded(self) -> bool:
        """Whether of every part of the map that is of several robots some robot says how exact it is by rounds."""
        told: dict[tuple[str, ...], bool] = {}
        for part in (part for robot in self.processes for part in self.status(robot)["rounds"]["parts"]):
            robots = tuple(part["robots"])
            told[robots] = told.get(robots, False) or bool(part["exactness"]) or len(robots) == 1
        return self.same() and bool(told) and all(told.values())

    def until(self, there: Callable[[], bool], seconds: float) -> bool:
        """Wait until something holds, and say whether it does."""
        ends = time.monotonic() + seconds
        while not there():
            if time.monotonic() > ends:
                return False
            self.refuse_the_dead()
            time.sleep(0.1)
        return True

    def refuse_the_dead(self) -> None:
        """Raise RuntimeError, with what it said, where a robot has ended by itself."""
        for robot, process in self.processes.items():
            if process.poll() is not None:
                raise RuntimeError(f"robot {robot} ended with {process.returncode}: {self.said(robot)}")

    def maps(self) -> dict[int, bytes]:
        """The maps that the robots wrote at their end, to the bit."""
        found = {robot: self.folder / str(robot) / "maps" for robot in self.places}
        return {n: bits_of_parts(read_submaps(path)) for n, path in found.items() if path.is_dir()}

    def offline_bits(self) -> bytes:
        """The offline join of the log as the robots read it, to the bit."""
        return bits_of(
            joined(SubmapSet.of(*offline_submaps(read(self.folder / "log"), Options(poses_per_piece=PIECE))))
        )


def local_places(robots: Sequence[int]) -> dict[int, str]:
    """Free ports of this machine."""
    places = {}
    for robot in robots:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            places[robot] = f"127.0.0.1:{probe.getsockname()[1]}"
    return places
