"""`teamslam exchange`: what each link of a team would cost, in every kind of message, before anything is sent."""

import csv
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

if TYPE_CHECKING:
    from teamslam.model import Names
    from teamslam.team import Ledger


def exchange(
    log: Path,
    /,
    *,
    topology: Literal["star", "all"] = "star",
    shift: float = 0.03,
    information: float = 0.01,
    to_the_bit: Annotated[bool, Parameter(negative="")] = False,
    landmarks: Annotated[bool, Parameter(negative="")] = False,
    keyframe: int | None = None,
    poses_per_piece: int | None = None,
    format: str | None = None,
    ledger: Path | None = None,
) -> int:
    """Show what the exchange of a team's submaps would cost: bytes on each link, by kind of message.

    Every submap is made into a message of every kind, and the smallest goes, so no link costs more than raw.

    ```
    teamslam exchange MRCLAM_Dataset6 --keyframe 50
    teamslam exchange my-team --topology all --shift 0.01
    teamslam exchange my-team --to-the-bit --ledger messages.csv
    ```

    Kinds:

    ```
    raw        the measurements, as they are
    sparse     the submap, with its information matrix as it is
    partial    variables that nobody else knows eliminated, while that makes the message smaller
    condensed  all of them eliminated
    ```

    Exit codes: 0 done; 1 some submap could not be built; 2 bad input or usage.

    Parameters
    ----------
    log
        A log: a folder or file in any format that `teamslam convert --help` lists.
    topology
        star: every robot sends to the first. all: everyone sends to everyone.
    shift
        How far rounding may move the map, in sigmas, for each message.
    information
        How far rounding may change what a message knows, as a share, in any direction.
    to_the_bit
        Round nothing.
    landmarks
        Keep every landmark, so that all get the whole landmark map.
    keyframe
        Keep only every n-th sighting of each pair of robots.
    poses_per_piece
        Cut each robot's log after so many poses. Without it a log is one piece, but for gaps in its odometry.
    format
        The format of the log, where it cannot be told from its looks.
    ledger
        Write every message on every link into this CSV file: who sends what to whom, in which kind, how many bytes.
    """
    from teamslam.cli.console import progress_bar, say, table
    from teamslam.cli.pieces import pieces_of
    from teamslam.joining import build
    from teamslam.team import plan
    from teamslam.wire import EXACT, KINDS, Precision

    precision = EXACT if to_the_bit else Precision(shift, information)
    pieces = pieces_of(log, format=format, poses_per_piece=poses_per_piece, keyframe=keyframe)
    team = []
    with progress_bar() as progress:
        for number, piece in enumerate(pieces, 1):
            progress("building submaps", number, len(pieces))
            team.append((piece, build(piece)))
    found = plan(team, precision, topology=topology, landmarks=landmarks)
    names = pieces[0].names
    ledgers = {kind: found.ledger(kind).by_link() for kind in KINDS}
    sent = found.ledger()
    rows = []
    for link, cost in sent.by_link().items():
        picks = [line.kind for line in sent.lines if (line.sender, line.receiver) == link]
        picked = ", ".join(f"{picks.count(kind)} {kind}" for kind in KINDS if kind in picks)
        cells = [f"{ledgers[kind][link]:,}" for kind in KINDS]
        rows.append([f"{names.robot(link[0])} to {names.robot(link[1])}", str(len(picks)), *cells, f"{cost:,}", picked])
    totals = [f"{found.ledger(kind).total:,}" for kind in KINDS]
    rows.append(["all", str(len(sent.lines)), *totals, f"{sent.total:,}", ""])
    if ledger is not None:
        _write_ledger(sent, names, ledger)
    table(f"{log}: bytes on each link", ["link", "messages", *KINDS, "sent", "as"], rows)
    worst = max((offer.pick.rounding.shift_sigma for offer in found.offers), default=0.0)
    say("to the bit" if to_the_bit else f"rounded: a message moves the map by at most {worst:.3f} sigma")
    if keyframe is not None and pieces[0].dropped:
        say(f"left out: {pieces[0].dropped[-1].count} {pieces[0].dropped[-1].reason}")
    return 0


def _write_ledger(sent: "Ledger", names: "Names", path: Path) -> None:
    from io import StringIO

    from teamslam.io.files.whole import whole_file

    text = StringIO(newline="")
    out = csv.writer(text)
    out.writerow(["sender", "receiver", "kind", "submap", "version", "bytes"])
    for line in sent.lines:
        out.writerow(
            [names.robot(line.sender), names.robot(line.receiver), line.kind, line.id, line.version, line.bytes]
        )
    with whole_file(path) as file:
        file.write(text.getvalue().encode())
