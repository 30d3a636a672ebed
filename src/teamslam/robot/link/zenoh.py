"""Links over a network: Eclipse Zenoh, each robot a peer among peers; encrypted and by certificate where there are any.

    key     teamslam/TEAM/TO/FROM      TO 0: to all
    token   teamslam/TEAM/alive/ROBOT  while it is there and in reach
    rows    teamslam/TEAM/rows/ROBOT   what its sensors measure, told by a program of its own

With certificates both ends of every connection prove that they are of the team, and what comes under FROM is taken
only from whoever's certificate bears that name: nobody speaks for another. A packet is handed over by a thread of its
own, so that a slow or frozen peer makes no step wait; where the network cannot keep up packets are dropped, which the
exchange is made for.
"""

import json
import queue
import threading
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from teamslam.errors import InputError, MissingExtraError
from teamslam.robot.link import HEARD
from teamslam.robot.link.inbox import Inbox
from teamslam.robot.link.keys import AUTHORITY, common_name

ALIVE, ROWS = "alive", "rows"  # in place of a robot's number
WAITING = 1000  # packets that wait to be handed over at most; more are dropped
LEASE_MS = 20_000  # a peer that says nothing for so long is gone; TCP may, where a third of all packets is lost
OPENS_MS = 30_000  # a connection is made within; there shaking hands takes more than Zenoh's own 10 s, again and again


@dataclass(frozen=True)
class Address:
    """Where a robot is among its team: `team`'s name, its number, where it listens and whom it connects to
    ('192.168.1.7:7447'), and the folder with its certificate (None: in the clear, for tests and trusted wires).
    `members`: the robots that are heard at all; one that is revoked is left out."""

    team: str
    robot: int
    listen: str
    connect: tuple[str, ...] = ()
    certificates: Path | None = None
    members: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if not self.team or not self.team.replace("-", "").replace("_", "").isalnum():
            raise InputError(f"a team's name has letters, digits, - and _, found '{self.team}'", field="team")
        if self.certificates is not None and not self.members:
            raise InputError("with certificates, say which robots are members", field="members")


class ZenohLink:
    """One robot's end. Raises InputError where it cannot be opened, MissingExtraError without the package."""

    def __init__(self, address: Address) -> None:
        try:
            import zenoh
        except ModuleNotFoundError:
            raise MissingExtraError("links over a network need eclipse-zenoh: pip install 'teamslam[robots]'") from None
        self.address, self.dropped = address, 0
        self._inbox, self._alive = Inbox(), frozenset[int]()
        self._outbox: queue.Queue[tuple[int, bytes] | None] = queue.Queue(WAITING)
        try:
            self._session: Any = zenoh.open(zenoh.Config.from_json5(json.dumps(configuration(address))))
            alive = f"teamslam/{address.team}/{ALIVE}"
            self._token = self._session.liveliness().declare_token(f"{alive}/{address.robot}")
            self._watch = self._session.liveliness().declare_subscriber(f"{alive}/*", self._noticed, history=True)
            self._ears = [
                self._session.declare_subscriber(f"teamslam/{address.team}/{to}/*", self._heard)
                for to in (0, address.robot)
            ]
        except Exception as error:  # zenoh has one error for all
            raise InputError(f"the link cannot be opened at {address.listen}: {error}") from None
        self._mouth = threading.Thread(target=self._say, name=f"link of robot {address.robot}", daemon=True)
        self._mouth.start()
        self._rows: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()

    def rows(self) -> Iterator[bytes]:
        """What is told to the robot of its own rows, line by line, until an empty packet comes or the link is closed.
        With certificates only from who has the robot's own."""
        key = f"teamslam/{self.address.team}/{ROWS}/{self.address.robot}"
        self._ears.append(self._session.declare_subscriber(key, self._told))
        return iter(self._rows.get, None)

    def _told(self, sample: Any) -> None:
        for line in sample.payload.to_bytes().splitlines() or (None,):
            self._rows.put(line)

    def send(self, to: int, data: bytes) -> None:
        """A packet to a robot, or to all that can be reached (0)."""
        try:
            self._outbox.put_nowait((to, data))
        except queue.Full:
            self.dropped += 1

    def receive(self, most: int = HEARD) -> list[tuple[int, bytes]]:
        """Packets that have come, at most so many, those of all senders in turns."""
        return self._inbox.take(most)

    @property
    def alive(self) -> frozenset[int]:
        """The robots whose tokens are there: of one whose process has ended it goes at once, of one that is out of
        reach after a while (`LEASE_MS`)."""
        return self._alive

    @property
    def shut_out(self) -> int:
        """How many packets of others were dropped, because they sent more than is heard."""
        return self._inbox.dropped.total()

    def close(self) -> None:
        """Leave; what waits to be handed over is, if that is quick. Where the network does not let one take one's leave
        in time, one is gone without."""
        self._rows.put(None)
        with suppress(queue.Full):
            self._outbox.put(None, timeout=1.0)
        self._mouth.join(5.0)
        with suppress(Exception):  # zenoh has one error for all
            self._session.close()

    def _heard(self, sample: Any) -> None:
        sender = _robot_in(sample)
        if sender not in (None, self.address.robot):
            self._inbox.put(sender, sample.payload.to_bytes())

    def _noticed(self, sample: Any) -> None:
        """A token has come or gone; this is called by one thread."""
        robot = _robot_in(sample)
        if robot in (None, self.address.robot):
            return
        there = str(sample.kind).upper().endswith("PUT")
        self._alive = self._alive | {robot} if there else self._alive - {robot}

    def _say(self) -> None:
        while (packet := self._outbox.get()) is not None:
            to, data = packet
            try:
                self._session.put(f"teamslam/{self.address.team}/{to}/{self.address.robot}", data)
            except Exception:
                self.dropped += 1


def _robot_in(sample: Any) -> Any:
    """The robot that a key ends with; None where it ends with another word."""
    name = str(sample.key_expr).rpartition("/")[2]
    return int(name) if name.isdigit() else None


def configuration(address: Address) -> dict[str, Any]:
    """What Zenoh is told."""
    kind = "tcp" if address.certificates is None else "tls"
    found: dict[str, Any] = {
        "mode": "peer",
        "listen": {"endpoints": [f"{kind}/{address.listen}"]},
        "connect": {"endpoints": [f"{kind}/{place}" for place in address.connect]},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": True}},
        "transport": {
            "unicast": {"open_timeout": OPENS_MS, "accept_timeout": OPENS_MS},
            "link": {"tx": {"lease": LEASE_MS}},
        },
    }
    if address.certificates is not None:
        found["transport"]["link"]["tls"] = _tls(address, address.certificates)
        found["access_control"] = _access(address.team, address.members)
    return found


def _tls(address: Address, folder: Path) -> dict[str, Any]:
    name = common_name(address.robot)
    for path in (folder / f"{AUTHORITY}.crt", folder / f"{name}.crt", folder / f"{name}.key"):
        if not path.exists():
            raise InputError("there is no such file; `teamslam keys` makes it", path=path)
    own = {side: str(folder / name) for side in ("listen", "connect")}
    return {
        "root_ca_certificate": str(folder / f"{AUTHORITY}.crt"),
        "enable_mtls": True,
        "verify_name_on_connect": True,
        **{f"{side}_certificate": f"{path}.crt" for side, path in own.items()},
        **{f"{side}_private_key": f"{path}.key" for side, path in own.items()},
    }


def _access(team: str, members: Sequence[int]) -> dict[str, Any]:
    """Who may say what: each member under its own name alone; all may listen; nobody else anything."""
    says = [
        {
            "id": f"says-{robot}",
            "messages": ["put"],
            "flows": ["ingress"],
            "permission": "allow",
            "key_exprs": [f"teamslam/{team}/*/{robot}"],
        }
        for robot in members
    ]
    says += [
        {
            "id": f"lives-{robot}",
            "messages": ["liveliness_token"],
            "flows": ["ingress"],
            "permission": "allow",
            "key_exprs": [f"teamslam/{team}/{ALIVE}/{robot}"],
        }
        for robot in members
    ]
    everything = [f"teamslam/{team}/**"]
    listens = {
        "id": "listens",
        "messages": ["declare_subscriber", "declare_liveliness_subscriber", "liveliness_query"],
        "flows": ["ingress", "egress"],
        "permission": "allow",
        "key_exprs": everything,
    }
    answers = {
        "id": "answers",
        "messages": ["put", "liveliness_token"],
        "flows": ["egress"],
        "permission": "allow",
        "key_exprs": everything,
    }
    subjects = [{"id": common_name(robot), "cert_common_names": [common_name(robot)]} for robot in members]
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [*says, listens, answers],
        "subjects": subjects,
        "policies": [
            {"rules": [f"says-{robot}", f"lives-{robot}", "listens", "answers"], "subjects": [common_name(robot)]}
            for robot in members
        ],
    }
