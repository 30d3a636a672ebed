"""`teamslam exchange`: what each link of a team would cost, in every kind of message, before anything is sent."""

import csv
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from teamslam.cli.numbers import MaybeWhole

if TYPE_CHECKING:
    from teamslam.model import Names
    from teamslam.team import Ledger, Plan


def exchange(
    log: Path,
    /,
    *,
    topology: Literal["star", "all"] = "star",
    shift: float | None = None,
    information: float | None = None,
    to_the_bit: Annotated[bool, Parameter(negative="")] = False,
    landmarks: Annotated[bool, Parameter(negative="")] = False,
    keyframe: MaybeWhole = None,
    poses_per_piece: MaybeWhole = None,
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

    Exit codes: 0 done; 2 bad input or usage; 4 some submap could not be built.

    Parameters
    ----------
    log
        A log: a folder or file in any format that `teamslam convert --help` lists.
    topology
        star: every robot sends to the first. all: everyone sends to everyone.
    shift
        How far rounding may move the estimate in each message, in its own sigmas; 0.03 without it, 0 for not at all.
    information
        How far rounding may change what a message knows, as a share, in any direction; 0.01 without it, 0 for not at
        all.
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
        Write every message on every link into this CSV file, which must not exist: who sends what to whom, in which
        kind, how many bytes.
    """
    from teamslam.cli.console import answer, progress_bar, say, table
    from teamslam.cli.pieces import pieces_of
    from teamslam.errors import InputError
    from teamslam.joining import build
    from teamslam.team import plan
    from teamslam.wire import EXACT, Precision

    if to_the_bit and (shift is not None or information is not None):
        raise InputError("--to-the-bit rounds nothing: leave out --shift and --information")
    if ledger is not None and ledger.exists():
        raise InputError("the ledger is there already; choose another name", path=ledger)
    near = Precision()
    precision = (
        EXACT
        if to_the_bit
        else Precision(
            near.shift_sigma if shift is None else shift, near.information if information is None else information
        ).as_limit()
    )
    pieces = pieces_of(log, format=format, poses_per_piece=poses_per_piece, keyframe=keyframe)
    if len({piece.tables[0].robot for piece in pieces}) < 2:
        say(f"{log}: one robot, nothing to exchange")
        answer({"messages": [], "bytes": 0, "ledger": None})
        return 0
    team = []
    with progress_bar() as progress:
        for number, piece in enumerate(pieces, 1):
            team.append((piece, build(piece)))
            progress("building submaps", number, len(pieces))
    found, names = plan(team, precision, topology=topology, landmarks=landmarks), pieces[0].names
    if ledger is not None:  # before anything is printed, which may break off
        _write_ledger(found.ledger(), names, ledger)
    table(f"{log}: bytes on each link", *_costs(found, names))
    worst = [offer.pick.rounding for offer in found.offers]
    if to_the_bit:
        say("to the bit: nothing is rounded")
    else:
        say(
            f"rounded: the estimate of a message by at most {max(r.shift_sigma for r in worst):.3f} sigma, "
            f"its information by at most {max(r.information for r in worst):.1%} in any direction"
        )
    for dropped in pieces[0].dropped:
        say(f"left out: {dropped.count}: {dropped.reason}")
    if ledger is not None:
        say(f"written: {ledger}")
    answer(
        {"messages": _messages(found.ledger(), names), "bytes": found.ledger().total, "ledger": ledger and str(ledger)}
    )
    return 0


def _costs(found: "Plan", names: "Names") -> tuple[list[str], list[list[str]]]:
    """The table of bytes: a row a link, a column a kind of message, and what is sent."""
    from teamslam.wire import KINDS

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
    return ["link", "messages", *KINDS, "sent", "as"], rows


def _messages(sent: "Ledger", names: "Names") -> list[dict[str, Any]]:
    """Every message on every link, as the ledger's CSV has them."""
    return [
        {
            "sender": names.robot(line.sender),
            "receiver": names.robot(line.receiver),
            "kind": line.kind,
            "submap": line.id,
            "version": line.version,
            "bytes": line.bytes,
        }
        for line in sent.lines
    ]


def _write_ledger(sent: "Ledger", names: "Names", path: Path) -> None:
    from io import StringIO

    from teamslam.io.files.whole import whole_file

    text = StringIO(newline="")
    out = csv.writer(text)
    out.writerow(["sender", "receiver", "kind", "submap", "version", "bytes"])
    out.writerows(message.values() for message in _messages(sent, names))
    with whole_file(path) as file:
        file.write(text.getvalue().encode())
