"""`teamslam keys`: the certificates of a team."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from teamslam.cli.numbers import whole


def keys(
    out: Path,
    /,
    *,
    robots: Annotated[tuple[int, ...], Parameter(converter=whole, consume_multiple=True, negative="")],
    hosts: Annotated[tuple[str, ...], Parameter(consume_multiple=True, negative="")] = ("127.0.0.1", "localhost"),
) -> int:
    """Make the certificates by which the robots of a team know each other.

    The folder gets an authority, where it has none, and a certificate and a key for each robot. Copy `authority.crt`,
    `robot-3.crt` and `robot-3.key` to robot 3, and keep `authority.key` on no robot: who has it can make robots of the
    team. A robot is revoked by leaving it out of the members of the others.

    ```
    teamslam keys secrets --robots 1 2 3
    teamslam keys secrets --robots 4 --hosts 192.168.1.4 robot-4.local
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
    """
    from teamslam.cli.console import say
    from teamslam.results.words import counted
    from teamslam.robot.link.keys import make_certificates

    make_certificates(out, robots, hosts)
    say(f"written: {out}: {counted(len(robots), 'certificate')}")
    return 0
