"""Robots and names that lie, found: how often, and how often honest teams are accused.

    python benchmarks/liars.py [--teams 50] [--honest 100] [--first-seed 0] [--out docs/benchmarks/liars.md]
    python benchmarks/liars.py --pairs LOG [--first-seed 0] [--every 1] [--out docs/benchmarks/liars.md]

Simulated teams of 4 robots, 60 poses each, 30 landmarks, in the plane, on the ground among landmarks in space, and in
space. Planted is one fault a team: a robot whose lengths are all 1.1 times too long, one whose landmarks are made up,
one whose odometry turns 0.05 rad too far at every step, two landmarks that one robot calls by each other's names (drawn
among those that it and others know), or two robots that a third takes for each other. Honest teams have none. `right`:
exactly the fault is named. `in part`: the fault is named, and said to be as likely another robot's; or the faulty robot
is, with another reason; or robots are said to contradict each other with nobody named. `unchecked`: nothing is said of
a robot that shares fewer than three landmarks with the others, and neither sees a robot nor is seen: nobody can know.
`wrong`: an innocent robot or name is accused. With --pairs, of a log every pair of landmarks is exchanged once, by a
robot drawn at random (or every so many-th pair), and --out appends what was told to the page.
"""

import argparse
import itertools
import os
import platform
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

import teamslam
from teamslam.joining import build, split
from teamslam.model import Dataset, Submap, robot_of
from teamslam.sim import Options, simulate
from teamslam.sim.faults import exchanged, made_up, stretched, taken_for_another, turning
from teamslam.trust import Suspicions, suspicions
from teamslam.trust.labels.constellations import renamed

SPACES = ("2d", "planar", "3d")
ROBOTS = 4


def checked(log: Dataset, robot: int) -> bool:
    """Whether anybody can know of a robot's landmarks: it shares three, or takes part in a sighting of robots."""
    met = [t.robot == robot or (robot_of(t.keys[:, 1]) == robot).any() for t in log.tables if t.source == "robots"]
    rows = [(t.robot, t.keys[:, 1]) for t in log.tables if t.source == "landmarks"]
    own, others = (np.concatenate([k for r, k in rows if (r == robot) is mine]) for mine in (True, False))
    return any(met) or len(np.intersect1d(own, others)) > 2


def submaps_of(log: Dataset) -> list[Submap]:
    """A submap a piece."""
    return [build(piece) for piece in split(log)]


def honest(log: Dataset, seed: int) -> tuple[Dataset, Callable[[Suspicions], str]]:
    """No fault."""
    return log, lambda found: "right" if not list(found.sentences()) else "WRONG"


def lying(fault: Callable[[Dataset, int, int], Dataset]) -> Callable[[Dataset, int], object]:
    """A fault of one robot."""

    def planted(log: Dataset, seed: int) -> tuple[Dataset, Callable[[Suspicions], str]]:
        liar = 1 + seed % ROBOTS

        def told(found: Suspicions) -> str:
            assert found.judgement is not None
            themselves = tuple(found.judgement.themselves)
            if found.labels or set(found.liars) - {liar} or set(themselves) - {liar}:
                return "WRONG"
            if found.liars or themselves:
                return "right"
            if found.judgement.undecidable:
                return "in part"
            return "missed" if checked(log, liar) else "unchecked"

        return fault(log, liar, seed), told

    return planted


def misnamed(log: Dataset, seed: int) -> tuple[Dataset, Callable[[Suspicions], str]]:
    """Two names exchanged by one robot."""
    robot, rng = 1 + seed % ROBOTS, np.random.default_rng([seed, 5])
    seen = {
        r: np.unique(np.concatenate([t.keys[:, 1] for t in log.tables if (t.robot, t.source) == (r, "landmarks")]))
        for r in log.robots
    }
    both = np.intersect1d(seen[robot], np.concatenate([marks for r, marks in seen.items() if r != robot]))
    one, other = (int(mark) for mark in rng.choice(both, 2, replace=False))

    def told(found: Suspicions) -> str:
        word = told_of_names(found, robot, one, other)
        return word if word != "missed" or checked(log, robot) else "unchecked"

    return exchanged(log, robot, one, other), told


def confused(log: Dataset, seed: int) -> tuple[Dataset, Callable[[Suspicions], str]]:
    """A robot takes two others for each other, in all sightings; the one that names others most often."""
    sightings = {t.robot: len(t) for t in log.tables if t.source == "robots"}
    robot = max(sightings, key=lambda r: sightings[r])
    seen = np.concatenate([robot_of(t.keys[:, 1]) for t in log.tables if (t.robot, t.source) == (robot, "robots")])
    who, times = np.unique(seen, return_counts=True)
    one = int(who[np.argmax(times)])
    other = next(r for r in log.robots if r not in (robot, one))

    def told(found: Suspicions) -> str:
        named = {(m.by, m.named, m.right) for m in found.mistaken}
        if named - {(robot, one, other), (robot, other, one)} or found.labels or set(found.liars) - {robot}:
            return "WRONG"
        if found.liars:
            return "in part"
        return "right" if (robot, other, one) in named else "missed"

    return taken_for_another(log, robot, one, other), told


def told_of_names(found: Suspicions, robot: int, one: int, other: int) -> str:
    """What was said of an exchange of names."""
    if not found.labels and not found.liars:
        return "missed"
    if not found.labels and set(found.liars) == {robot}:
        return "in part"
    if len(found.labels) != 1 or found.liars:
        return "WRONG"
    label = found.labels[0]
    if label.change.kind != "exchanged" or {label.change.one, label.change.other} != {one, other}:
        return "WRONG"
    if label.change.robot == robot and not label.instead:
        return "right"
    return "in part" if robot in (label.change.robot, *label.instead) else "WRONG"


KINDS: dict[str, Callable[[Dataset, int], object]] = {
    "honest": honest,
    "lengths 1.1 times": lying(lambda log, robot, seed: stretched(log, robot, 1.1)),
    "made-up landmarks": lying(made_up),
    "turning 0.05 rad a step": lying(lambda log, robot, seed: turning(log, robot, 0.05)),
    "names exchanged": misnamed,
    "robots confused": confused,
}


def table(teams: int, clean: int, first: int) -> Iterator[str]:
    """The rows, as they come."""
    yield "| space | planted | teams | right | in part | unchecked | missed | wrong |"
    yield "|---" * 8 + "|"
    for space in SPACES:
        for name, planted in KINDS.items():
            told: Counter[str] = Counter()
            count = clean if planted is honest else teams
            for seed in range(first, first + count):
                log, judge = planted(simulate(Options(space=space, robots=ROBOTS), seed), seed)  # type: ignore[misc]
                told[judge(suspicions(log, submaps_of(log)))] += 1
            counts = " | ".join(str(told[word]) for word in ("right", "in part", "unchecked", "missed", "WRONG"))
            yield f"| {space} | {name} | {count} | {counts} |"


def pairs(path: Path, first: int, every: int) -> Iterator[str]:
    """Of one log, every pair exchanged once, or every so many-th."""
    log = teamslam.read(path)
    assert isinstance(log, Dataset)
    submaps = submaps_of(log)
    clean = suspicions(log, submaps)
    yield f"as it is: {list(clean.sentences()) or 'nothing suspicious'}"
    told: Counter[str] = Counter()
    rng = np.random.default_rng(first)
    for one, other in list(itertools.combinations(log.landmark_keys.tolist(), 2))[::every]:
        robot = int(rng.choice(list(log.robots)))
        names = {one: other, other: one}
        lie = [renamed(submap, names) if robot in submap.robots else submap for submap in submaps]
        told[told_of_names(suspicions(exchanged(log, robot, one, other), lie), robot, one, other)] += 1
        if sum(told.values()) % 15 == 0:
            yield f"{sum(told.values())} pairs: {dict(told)}"
    yield f"{sum(told.values())} pairs: {dict(told)}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--teams", type=int, default=50)
    parser.add_argument("--honest", type=int, default=100)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--pairs", type=Path)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    lines = []
    rows = (
        pairs(given.pairs, given.first_seed, given.every)
        if given.pairs
        else table(given.teams, given.honest, given.first_seed)
    )
    for line in rows:
        lines.append(line)
        print(line, flush=True)
    if given.out and given.pairs:
        with given.out.open("a", encoding="utf-8") as file:
            file.write(section(lines, given))
    elif given.out:
        given.out.write_text(page(lines, given), encoding="utf-8")


def section(lines: Sequence[str], given: argparse.Namespace) -> str:
    """What the page of the documentation says of a log's pairs."""
    how = f"python benchmarks/liars.py --pairs {given.pairs.name} --first-seed {given.first_seed} --every {given.every}"
    return f"\n## Pairs of {given.pairs.name}, exchanged\n\nMeasured by `{how}`.\n\n- {lines[0]}\n- {lines[-1]}\n"


def page(lines: Sequence[str], given: argparse.Namespace) -> str:
    """The page of the documentation."""
    assert __doc__ is not None
    how = f"python benchmarks/liars.py --teams {given.teams} --honest {given.honest} --first-seed {given.first_seed}"
    made = f"teamslam {teamslam.__version__}, NumPy {np.__version__}, Python {platform.python_version()}"
    method = __doc__.split("\n\n")[2]
    return f"# Robots and names that lie\n\nMeasured by `{how}`; {made}.\n\n{method}\n\n" + "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
