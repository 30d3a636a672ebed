"""Who made a body: the signature of its robot, over the team's name and the bytes, which every robot checks before it
opens them.

    a submap        is signed by the robot whose rows it holds, all of them, and bears an id that begins with its name
    an announcement is signed by the robot that knows
    a removal       is signed by the robot whose submaps are out, or by whoever makes the team's certificates

So neither who passes a body on nor another member can alter, invent or withdraw one. It knows functions that sign and
verify, and nothing of what they do: `link.keys` makes them of files.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from teamslam.errors import InputError
from teamslam.model import Names
from teamslam.robot.opened import Opened
from teamslam.robot.packets import Body

HOME = 0  # in place of a robot's number: whoever makes the team's certificates

Sign = Callable[[bytes], bytes]
Verify = Callable[[bytes, bytes], bool]


@dataclass(frozen=True, eq=False)
class Seal:
    """A robot's own signature, and how it knows those of the members (`known`, HOME among them), of the team `team`.
    `names`: what the robots are called, of all robots the same."""

    team: str
    robot: int
    sign: Sign
    known: Mapping[int, Verify]
    names: Names = field(default_factory=Names)

    def signed(self, data: bytes) -> Body:
        """A body of its own."""
        return Body(data, self.robot, self.sign(spoken(self.team, data)))

    def verify(self, body: Body) -> None:
        """Raises InputError where a body is not signed by the member whose it says it is."""
        verify = self.known.get(body.robot)
        if verify is None:
            raise InputError(f"a body that robot {body.robot} signed, which is no member", field="signature")
        if not verify(body.signature, spoken(self.team, body.data)):
            raise InputError(
                f"a body is not what robot {body.robot} signed: its signature does not fit that robot's certificate "
                f"here, or team {self.team}",
                field="signature",
            )

    def refuse_borrowed(self, body: Body, found: Opened) -> None:
        """Raises InputError where a body, opened, is not of the robot that signed it."""
        entry, signer = found.entry, body.robot
        if signer == HOME and (entry.gone or entry.robot):
            return
        if not found.robots:
            raise InputError(
                f"robot {signer} signed a submap that names no rows; they could count twice", field="signature"
            )
        if (robots := {*found.robots, found.base}) != {signer}:
            whose = ", ".join(map(str, sorted(robots)))
            raise InputError(f"robot {signer} signed a body that is of robot {whose}", field="signature")
        name = self.names.robot(signer)
        if not entry.robot and not entry.knows and entry.id.rpartition("/")[0] != name:
            raise InputError(
                f"robot {signer} signed a body with the id {entry.id}; here it is called {name}, and its ids are "
                f"{name}/...: give all robots the same names",
                field="signature",
            )


def spoken(team: str, data: bytes) -> bytes:
    """What is signed: nothing that is signed for another purpose, or in another team, is the same."""
    return b"teamslam body\0" + team.encode() + b"\0" + data
