"""`teamslam keys`: the certificates of a team."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from teamslam.cli.numbers import whole


def keys(
    out: Path,
    /,
    *,
    robots: Annotated[tuple[int, ...], Parameter(converter=whole, consume_multiple=True, negative="")] = (),
    hosts: Annotated[tuple[str, ...], Parameter(consume_multiple=True, negative="")] = ("127.0.0.1", "localhost"),
    revoke: Annotated[tuple[int, ...], Parameter(converter=whole, consume_multiple=True, negative="")] = (),
    team: str = "team",
) -> int:
    """Make the certificates by which the robots of a team know each other.

    The folder gets an authority, where it has none, and for each robot a certificate by which it proves who it is, one
    by which it signs its submaps, and their keys. Copy `authority.crt`, all `*.sign.crt`, and robot 3's own
    `robot-3.*` to robot 3. Keep `authority.key` on no robot: who has it can make robots of the team.

    A robot is revoked by leaving it out of the members of the others; and, without waiting for that, by a file
    (`robot-3.revoked`) in the certificates' folder of one of them, which tells the others: its submaps are out, and
    nobody listens to it.

    ```
    teamslam keys secrets --robots 1 2 3
    teamslam keys secrets --robots 4 --hosts 192.168.1.4 robot-4.local
    teamslam keys secrets --revoke 3 --team blue
    ```

    Exit codes: 0 done; 2 bad input or usage.

    Parameters
    ----------
    out
        The folder of the certificates.
    robots
        The numbers of the robots.
    hosts
        Names and addresses at which these robots will be reached.
    revoke
        The numbers of robots whose submaps are out from now on, for ever.
    team
        The name of the team in which they are revoked, as the robots have it.
    """
    from teamslam.cli.console import say
    from teamslam.errors import InputError
    from teamslam.results.words import counted
    from teamslam.robot.link import keys as made

    if not robots and not revoke:
        raise InputError("say for which robots, with --robots, or --revoke")
    if robots:
        made.make_certificates(out, robots, hosts)
        say(f"written: {out}: {counted(len(robots), 'robot')}")
    if revoke:
        made.revoke(out, team, revoke)
        say(f"written: {out}: {', '.join(f'{made.common_name(robot)}.revoked' for robot in revoke)}")
    return 0
