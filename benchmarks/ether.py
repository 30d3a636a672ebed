"""Robots in network namespaces of their own, and between them an ether that loses, delays and tears apart.

Each namespace has one device (tun) with one address; all that a robot sends goes through the kernel's own TCP, and then
as IP packets through this process, which plays the weather. Where the kernel has it, `tc netem` on the device plays it
instead, and this process only says who reaches whom.

    ether = Ether([1, 2, 3], Weather(loss=0.3, delay_s=0.5, rate=20e3), seed=0)
    subprocess.Popen([*ether.inside(2), "teamslam", "robot", ...])      # in robot 2's namespace, as 10.77.0.2
    ether.apart = {(1, 2)}                                              # for a while 1 and 2 do not reach each other

It needs namespaces of a user's own and /dev/net/tun; `in_a_namespace` starts a script again where it has these, or says
why there are none. No other network of the machine is touched, and none can be reached from inside.
"""

import fcntl
import heapq
import os
import selectors
import struct
import subprocess
import sys
import threading
import time
from dataclasses import dataclass

import numpy as np

INSIDE = "TEAMSLAM_IN_A_NAMESPACE"
SKIPPED = 77  # the exit code of what cannot run on this machine
TUNSETIFF, IFF_TUN, IFF_NO_PI = 0x400454CA, 1, 0x1000
QUEUE = 100  # packets that wait for a line at most


@dataclass(frozen=True)
class Weather:
    """Of every packet between two robots, in each direction: the share lost, the delay [s], and bytes a second."""

    loss: float = 0.0
    delay_s: float = 0.0
    rate: float | None = None

    @property
    def netem(self) -> list[str]:
        """In the words of `tc`."""
        rate = ["rate", f"{int(8 * self.rate)}bit"] if self.rate else []
        return [
            "netem",
            "loss",
            f"{100 * self.loss:g}%",
            "delay",
            f"{1000 * self.delay_s:g}ms",
            *rate,
            "limit",
            str(QUEUE),
        ]


def in_a_namespace() -> None:
    """Go on only within user and network namespaces of one's own: the script is started again in them. Where there
    are none, the reason is told, and the script ends with SKIPPED."""
    if os.environ.get(INSIDE):
        return
    try:
        probe = ["unshare", "-rn", "sh", "-c", "ip tuntap add dev air0 mode tun && ip link show air0"]
        tried = subprocess.run(probe, capture_output=True, text=True, check=False)
        reason = tried.stderr.strip() if tried.returncode else ""
    except OSError as error:
        reason = str(error)
    if reason:
        print(f"this machine allows no network namespaces with devices of their own: {reason}", file=sys.stderr)
        sys.exit(SKIPPED)
    os.environ[INSIDE] = "1"
    os.execvp("unshare", ["unshare", "-rn", sys.executable, *sys.argv])


def has_netem() -> bool:
    """Whether this kernel has `tc netem`."""
    probe = ["unshare", "-n", "tc", "qdisc", "add", "dev", "lo", "root", "netem", "delay", "1ms"]
    return subprocess.run(probe, capture_output=True, check=False).returncode == 0


class Ether:
    """What connects some robots, from now until it is closed. `apart`: pairs that do not reach each other now;
    `netem`: whether the kernel plays the weather; `carried`: bytes of IP packets by sender and receiver."""

    def __init__(self, robots: list[int], weather: Weather, seed: int, *, netem: bool = False) -> None:
        self.weather, self.netem = weather, netem
        self.apart: set[tuple[int, int]] = set()
        self.carried: dict[tuple[int, int], int] = {}
        self._rng = np.random.default_rng(seed)
        self._homes = {robot: subprocess.Popen(["unshare", "-n", "sleep", "infinity"]) for robot in robots}
        time.sleep(0.3)  # until each is in its namespace
        self._ends = {robot: self._device(robot) for robot in robots}
        self._flying: list[tuple[float, int, int, bytes]] = []
        self._lines: dict[tuple[int, int], list[float]] = {}
        self._count, self._open = 0, True
        self._thread = threading.Thread(target=self._run, name="ether", daemon=True)
        self._thread.start()

    def __enter__(self) -> "Ether":
        return self

    def __exit__(self, *_: object) -> None:
        self._open = False
        self._thread.join()
        for end in self._ends.values():
            os.close(end)
        for home in self._homes.values():
            home.kill()
            home.wait()

    def inside(self, robot: int) -> list[str]:
        """What to write before a command so that it runs in a robot's namespace."""
        return ["nsenter", "-t", str(self._homes[robot].pid), "-n", "--"]

    @staticmethod
    def address(robot: int) -> str:
        """Where a robot is reached."""
        return f"10.77.{robot >> 8}.{robot & 255}"

    def _device(self, robot: int) -> int:
        name = f"air{robot}"
        end = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
        fcntl.ioctl(end, TUNSETIFF, struct.pack("16sH22x", name.encode(), IFF_TUN | IFF_NO_PI))
        subprocess.run(["ip", "link", "set", name, "netns", str(self._homes[robot].pid)], check=True)
        for words in (
            "ip link set lo up", f"ip addr add {self.address(robot)}/16 dev {name}", f"ip link set {name} up",
            *([f"tc qdisc add dev {name} root {' '.join(self.weather.netem)}"] if self.netem else []),
        ):  # fmt: skip
            subprocess.run([*self.inside(robot), *words.split()], check=True)
        return end

    # --- the weather ----------------------------------------------------------------------------------------------

    def _run(self) -> None:
        ears = selectors.DefaultSelector()
        for robot, end in self._ends.items():
            ears.register(end, selectors.EVENT_READ, robot)
        while self._open:
            now = time.monotonic()
            wait = min(0.1, max(0.0, self._flying[0][0] - now)) if self._flying else 0.1
            for key, _ in ears.select(wait):
                self._take(key.data, os.read(key.fd, 1 << 16))
            now = time.monotonic()
            while self._flying and self._flying[0][0] <= now:
                _, _, receiver, packet = heapq.heappop(self._flying)
                try:
                    os.write(self._ends[receiver], packet)
                except OSError:  # its own queue is full
                    continue

    def _take(self, sender: int, packet: bytes) -> None:
        receiver = (packet[18] << 8) + packet[19] if packet[0] >> 4 == 4 else 0
        if receiver not in self._ends or {(sender, receiver), (receiver, sender)} & self.apart:
            return
        line = (sender, receiver)
        self.carried[line] = self.carried.get(line, 0) + len(packet)
        arrives = time.monotonic() if self.netem else self._arrives(line, len(packet))
        if arrives is not None:
            self._count += 1
            heapq.heappush(self._flying, (arrives, self._count, receiver, packet))

    def _arrives(self, line: tuple[int, int], size: int) -> float | None:
        """When a packet is there; None where it is lost, or where too many wait for the line."""
        now, weather = time.monotonic(), self.weather
        if self._rng.random() < weather.loss:
            return None
        if weather.rate is None:
            return now + weather.delay_s
        waiting = [t for t in self._lines.get(line, []) if t > now]
        if len(waiting) >= QUEUE:
            return None
        gone = (waiting[-1] if waiting else now) + size / weather.rate
        self._lines[line] = [*waiting, gone]
        return gone + weather.delay_s
