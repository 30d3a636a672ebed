"""What exchange costs: simulated teams of 2 to 50 robots, and the landmark map of MRCLAM 6. Writes a page of tables.

    python benchmarks/exchange.py --mrclam MRCLAM_Dataset6 --out docs/benchmarks/exchange.md

Bytes are lengths of messages, everything included. The shift is measured: the map joined from what was sent against
the map joined from the whole submaps, in standard deviations of the latter, the largest over all variables that both
hold; the bound is what the messages guarantee together.
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import teamslam as ts
from teamslam.frontend.thin import keyframe
from teamslam.joining import build, join, split
from teamslam.model import Dataset, Submap
from teamslam.sim import Options, simulate
from teamslam.solver import Covariances
from teamslam.team import plan
from teamslam.wire import COMPACT, EXACT, KINDS, Message, Precision, receive, send, send_raw, shift_bound

TEAMS = (2, 5, 10, 20, 50)
EVERY = (1, 10)
SPACES = ("2d", "planar", "3d")
POSES = 60
SEED = 1


def main(mrclam: Path | None, out: Path | None) -> None:
    page = [HEAD.format(poses=POSES, seed=SEED)]
    for space in SPACES:
        for every in EVERY:
            rows = [list(row) for robots in TEAMS for row in simulated(space, robots, every)]
            sightings = "every sighting of a robot" if every == 1 else f"one sighting of a robot in {every}"
            page.append(f"## {space}, {sightings}\n\n" + table(TEAM_COLUMNS, rows))
            print(page[-1], flush=True)
    if mrclam is not None:
        log = ts.read(mrclam)
        for part in (*landmark_map(log), *full_exchange(log)):
            page.append(part)
            print(part, flush=True)
    if out is not None:
        out.write_text("\n".join(page), encoding="utf-8")


# --- simulated teams ----------------------------------------------------------------------------------------------


def simulated(space: str, robots: int, every: int) -> Iterator[Sequence[str]]:
    """A row to the bit and a row rounded."""
    log = keyframe(simulate(Options(space=space, robots=robots, poses=POSES, landmarks=10 * robots), SEED), every=every)
    team = [(piece, build(piece)) for piece in split(log)]
    whole = join(submap for _, submap in team).map
    for name, precision in (("to the bit", EXACT), ("rounded", COMPACT)):
        found = plan(team, precision, topology="all")
        costs = {kind: sum(len(offer.messages[kind]) for offer in found.offers) / robots for kind in KINDS}
        picked = [offer.pick for offer in found.offers]
        cells = [f"{costs[kind]:,.0f}" for kind in KINDS]
        sent = sum(map(len, picked)) / robots
        shift, bound = loss(whole, picked) if precision is COMPACT else (None, None)
        kinds = ", ".join(f"{n} {k}" for k in KINDS if (n := sum(m.kind == k for m in picked)))
        tail = ["", ""] if shift is None else [f"{shift:.3f}", f"{bound:.2f}"]
        yield [str(robots), name, *cells, f"**{sent:,.0f}**", f"{sent / costs['raw']:.2f}", kinds, *tail]


def loss(whole: Submap, messages: Sequence[Message]) -> tuple[float, float]:
    """The largest shift [sigma] of a map joined from messages against the whole one, and the bound on it."""
    received = [receive(message.data) for message in messages]
    submaps = [r.submap() for r in received]
    rounded = join(submaps).map
    return (
        largest_shift(whole, rounded),
        shift_bound(rounded, [(s, r.rounding) for s, r in zip(submaps, received, strict=True)]),
    )


def largest_shift(whole: Submap, other: Submap) -> float:
    """max |difference| / sigma over the unknowns of all variables that both hold."""
    shared = np.intersect1d(whole.values.layout.keys, other.values.layout.keys)
    exact = whole.values.only(shared)
    sigmas = np.concatenate([np.sqrt(np.diag(b)) for b in Covariances.of_map(whole).blocks(exact.layout.keys)])
    return float(np.abs(other.values.only(shared).minus(exact) / sigmas).max())


# --- MRCLAM -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Own:
    """One robot's own map, joined from its own submaps, and its whole log as one raw message's bytes."""

    robot: int
    map: Submap
    raw_bytes: int


def landmark_map(log: Dataset) -> Iterator[str]:
    """One message a robot: its own map condensed onto the landmarks."""
    alone = log.with_tables(t for t in log.tables if t.source != "robots")
    own = [own_map(alone, robot) for robot in sorted(alone.robots)]
    whole = join(o.map for o in own).map
    marks = len(whole.landmark_keys)
    rows = []
    for precision in (EXACT, Precision(0.01, 0.003), COMPACT):
        messages = [send("condensed", o.map, o.map.landmark_keys, precision) for o in own]
        shift, bound = loss(whole, messages)
        label = "to the bit" if precision == EXACT else f"{precision.shift_sigma:g} sigma, {precision.information:g}"
        rows.append([label, *(f"{len(m):,}" for m in messages), f"{shift:.4f}", f"{bound:.2f}"])
    names = [f"robot {o.robot}" for o in own]
    raw = ["raw log to the bit", *(f"{o.raw_bytes:,}" for o in own), "", ""]
    yield MRCLAM.format(marks=marks, numbers=2 * marks, information=marks * (2 * marks + 1))
    yield table(["rounded to", *names, "largest shift [sigma]", "bound [sigma]"], [*rows, raw])
    yield what_sightings_of_robots_add(log, whole)


def full_exchange(log: Dataset) -> Iterator[str]:
    """What every submap and every sighting of a robot cost, for several spacings of keyframes."""
    rows = []
    whole = join(build(piece) for piece in split(log)).map
    for every in (1, 2, 10, 50):
        thinned = keyframe(log, every=every)
        team = [(piece, build(piece)) for piece in split(thinned)]
        found = plan(team, COMPACT)
        robots = len(thinned.robots)
        costs = [sum(len(offer.messages[kind]) for offer in found.offers) / robots for kind in KINDS]
        sent = sum(len(offer.pick) for offer in found.offers) / robots
        sightings = sum(len(t) for t in thinned.tables if t.source == "robots")
        moved, _, wider = landmarks_against(join(submap for _, submap in team).map, whole)
        figures = [*(f"{c:,.0f}" for c in costs), f"**{sent:,.0f}**", f"{moved:.2f}", f"{wider:.2f}"]
        rows.append([f"one in {every}", str(sightings), *figures])
    yield FULL_EXCHANGE.format(rows=sum(len(t) for t in log.tables))
    yield table(["sightings of robots", "kept", *KINDS, "sent", "landmarks' shift [sigma]", "sigmas, times"], rows)


def what_sightings_of_robots_add(log: Dataset, alone: Submap) -> str:
    """How far the landmarks lie from where they would be with the sightings of robots."""
    shift, metres, ratio = landmarks_against(alone, join(build(piece) for piece in split(log)).map)
    return LEFT_OUT.format(shift=shift, metres=metres, ratio=ratio, expected=np.sqrt(1.0 - ratio**-2))


def landmarks_against(some: Submap, all_: Submap) -> tuple[float, float, float]:
    """The landmarks of a map of part of the measurements against the map of all: the largest shift in sigmas of the
    former and in metres, and how many times larger the former's sigmas are in the mean."""
    marks = all_.landmark_keys
    shift = np.abs(some.values.only(marks).minus(all_.values.only(marks)))
    mine, theirs = (np.sqrt(np.diag(Covariances.of_map(m).joint(marks))) for m in (some, all_))
    return float((shift / mine).max()), float(shift.max()), float(np.mean(mine / theirs))


def own_map(log: Dataset, robot: int) -> Own:
    """What a robot makes of its own log: its submaps, joined at home, where bytes cost nothing."""
    own = log.of_robot(robot)
    joined = join(build(piece) for piece in split(log) if piece.tables[0].robot == robot)
    return Own(robot, joined.map, len(send_raw(own, str(robot))))


# --- the page -----------------------------------------------------------------------------------------------------


def table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [columns, ["---"] + ["---:"] * (len(columns) - 1), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


TEAM_COLUMNS = (
    "robots", "numbers", *KINDS, "sent", "of raw", "as (messages)", "largest shift [sigma]", "bound [sigma]",
)  # fmt: skip

HEAD = """# What exchange costs

Measured by `python benchmarks/exchange.py --mrclam MRCLAM_Dataset6` (the published folder). Bytes for each robot, of
all its messages together, sent once.

- **raw**: the measurements, noise that they share once. **sparse**: whole submaps, the information as it is.
  **partial**: interiors eliminated while that makes the message smaller. **condensed**: all interiors eliminated.
- **sent**: for each message the smallest of the four, which is never more than raw.
- *to the bit*: floating-point numbers as they are; a pose as translation and rotation matrix (in the plane: sine and
  cosine). *rounded*: the estimate, or the measurements, move the map by at most 0.03 sigma, poses as 3 or 6 integers,
  and the information changes by at most 1 % in any direction; both are certified for each message.
- **largest shift**: measured; the map from what was sent against the map from whole submaps, over all variables that
  both hold. **bound**: what the messages guarantee together, to first order in the rounding, for any variable and any
  combination of variables of the joined map.

Simulated teams: {poses} poses a robot, ten landmarks a robot, the simulator's default sensors and paths, seed {seed}.
A row is one team; figures are of one run.
"""

MRCLAM = """## The landmark map of MRCLAM 6

Five real robots. Each joins its own submaps at home (sightings of landmarks and odometry; sightings of other robots
are left out) and sends one message: its map condensed onto the {marks} landmarks, {numbers} numbers and a dense
information matrix of {information}. Bytes of each robot's message, everything included; a good part of them says which
rows of the log went in, so that nothing counts twice.
"""

LEFT_OUT = """The shift is what the messages lose: they are compared with the join of the same measurements. The
sightings of other robots are further measurements, and they tell much: with them all (every submap joined with every
sighting) sigmas are {ratio:.1f} times smaller in the mean, so a map without them should lie about {expected:.1f} sigma
away, and does: no landmark moves by more than {shift:.2f} sigma ({metres:.3f} m). No message that leaves them out could
do better.
"""

FULL_EXCHANGE = """## All submaps of MRCLAM 6, sightings of robots included

Bytes for each robot, rounded; {rows:,} measurements in all. A sighting of a robot here is a range and a bearing: it
travels raw beside the submap, and both poses become separators. *landmarks' shift*: the farthest that a landmark lies
from the map of all sightings, in its own sigma; *sigmas, times*: how many times larger sigmas are than with all. Every
sighting brings news: leaving out every other one already moves a landmark by more than a tenth of a sigma.
"""

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--mrclam", type=Path, help="the folder MRCLAM_Dataset6; without it that table is left out")
    parser.add_argument("--out", type=Path, help="a page to write; without it all is printed only")
    arguments = parser.parse_args()
    main(arguments.mrclam, arguments.out)
