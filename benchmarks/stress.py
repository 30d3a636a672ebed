"""Random logs of every kind through teamslam: one told in full, or a campaign of thousands counted.

    python benchmarks/stress.py --seed 123                         what became of one log, by the drive drawn for it
    python benchmarks/stress.py --seed 123 --drive full --shrink   ... and the smallest part of it that still fails so
    python benchmarks/stress.py --seed 123 --rows "1/odometry:0-3 2/robots:0"             ... of some of its rows
    python benchmarks/stress.py --count 5000 --json stress.json    a campaign: failures by kind, each with its seeds;
                                                                   begun again, it goes on where it was
    python benchmarks/stress.py --middle --count 200               ... of logs of dozens to hundreds of poses
    python benchmarks/stress.py --teams --count 100                ... of simulated teams of hundreds of poses a robot
    python benchmarks/stress.py --real --count 200                 ... of published logs, cut, thinned and renamed
    python benchmarks/stress.py --known                            what of the suite's own logs fails, as known there
    python benchmarks/stress.py --page PAGE.md small.json middle.json teams.json real.json   what campaigns counted

What a log is made of, and what is checked of its outcome, is in tests/stress.
"""

import argparse
import json
import os
import platform
import signal
import sys
import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import nullcontext
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import FrameType

os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import stress_page
from conftest import CACHE, DATA, unpacked
from stress.drive import DRIVES, drive_of
from stress.failure import Failure
from stress.known import KNOWN
from stress.real import DRIVEN, LOGS, vary
from stress.scenario import draw
from stress.teams import draw_team
from stress.test_real import HANDFUL
from stress.test_stress import FIRST, MIDDLE, SMALL, TEAMS
from stress.verdict import Verdict, heard, judge, judge_real, judge_team, rows_in, smallest, told

KNOWN_FILE = Path(__file__).parents[1] / "tests" / "stress" / "known.py"
PATIENCE_S = 60  # of processor time; a log that takes longer hangs


@dataclass
class Row:
    """What became of one seed."""

    seed: int
    drive: str
    space: str
    noise: str
    faults: tuple[str, ...]
    ended: str
    seconds: float
    held: dict[str, int] = field(default_factory=dict)
    failures: list[dict[str, str]] = field(default_factory=list)
    unchecked: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class Kind:
    """Which logs: small ones, middle ones, simulated teams, or variations of published ones (of one, by its name)."""

    middle: bool = False
    teams: bool = False
    real: bool = False
    name: str | None = None

    def judge(self, seed: int, drive: str | None) -> Verdict:
        """The verdict on a seed's log."""
        if self.real:
            return judge_real(seed, published, name=self.name, drive=drive)
        return judge_team(seed, drive=drive) if self.teams else judge(seed, middle=self.middle, drive=drive)

    def blank(self, seed: int, drive: str | None) -> "Row":
        """What is known of a seed beforehand."""
        if self.real:
            scenario, _, drawn = vary(seed, published, self.name)
            return Row(seed, drive or drawn, scenario.space, scenario.noise, scenario.faults, "", 0.0)
        if self.teams:
            team = draw_team(seed)
            return Row(seed, drive or team.drive, team.space, team.noise, team.faults, "", 0.0)
        drawn_of = draw(seed, middle=self.middle)
        return Row(seed, drive or drive_of(seed), drawn_of.space, drawn_of.noise, drawn_of.faults, "", 0.0)


def published(name: str) -> Path:
    """A published log's file or folder; ends the program with the reason where it is not there."""
    for suffix in (".tar.xz", ".xz"):
        if (archive := DATA / f"{name}{suffix}").is_file():
            return unpacked(archive, CACHE / name)
    sys.exit(f"data set '{name}' is not in {DATA}; put its archive there or set TEAMSLAM_DATA")


def row_of(seed: int, kind: Kind, drive: str | None) -> Row:
    """One log, driven and checked."""
    row = kind.blank(seed, drive)
    began = time.process_time()
    signal.signal(signal.SIGPROF, _hangs)
    signal.setitimer(signal.ITIMER_PROF, PATIENCE_S)
    try:
        verdict = kind.judge(seed, drive)
        row.ended = ended(verdict)
        row.held = dict(verdict.findings.held)
        row.unchecked = dict(verdict.findings.unchecked)
        row.failures = [asdict(f) for f in verdict.findings.failures]
    except Exception as error:
        row.ended = "the check itself failed"
        row.failures = [asdict(Failure(f"check: {type(error).__name__}", str(error)))]
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
    row.seconds = time.process_time() - began
    return row


def _hangs(number: int, frame: FrameType | None) -> None:
    raise TimeoutError(f"no end after {PATIENCE_S} s")


def ended(verdict: Verdict) -> str:
    """In a map, several maps, or a sentence."""
    count = len(verdict.outcome.components)
    return "one map" if count == 1 else "several maps" if count else "a sentence"


def tell(verdict: Verdict) -> None:
    """One log in full."""
    outcome = verdict.outcome
    print(verdict.scenario)
    rows = told(rows_in(outcome.log))
    print(f"drive: {verdict.drive}; rows: {rows if len(rows) < 1000 else sum(map(len, outcome.log.tables))}")
    if outcome.error is not None:
        print(f"error: {type(outcome.error).__name__}: {outcome.error}")
    for component in outcome.components:
        status = component.solution.status.value if component.solution else "One submap, nothing to join."
        print(f"map {component.map.id}: {component.map.dof} unknowns, cost {component.map.cost:.6g}. {status}")
    for sentence in outcome.joined.reasons if outcome.joined else ():
        print(f"apart: {sentence}")
    print(f"{sum(verdict.findings.held.values())} statements held")
    for failure in verdict.findings.failures:
        print(f"FAILED {failure.kind}\n       {failure.detail}")


def rows_so_far(path: Path | None) -> list[Row]:
    """What a campaign counted before it was cut off: a line a log."""
    return rows_of(path) if path is not None and path.exists() else []


def rows_of(path: Path) -> list[Row]:
    """What a campaign counted: a line a log."""
    return [Row(**json.loads(line)) for line in path.read_text(encoding="utf-8").splitlines()]


def campaign(seeds: Sequence[int], kind: Kind, drive: str | None, workers: int, path: Path | None = None) -> list[Row]:
    """All seeds, told by kind of failure at the end; at `path` each as soon as it is known."""
    rows = [row for row in rows_so_far(path) if row.seed in seeds and drive in (None, row.drive)]
    left = sorted(set(seeds) - {row.seed for row in rows})
    with ProcessPoolExecutor(workers) as pool, path.open("a", encoding="utf-8") if path else nullcontext() as file:
        for row in pool.map(row_of, left, [kind] * len(left), [drive] * len(left)):
            rows.append(row)
            if file is not None:
                print(json.dumps(asdict(row)), file=file, flush=True)
            if len(rows) % 100 == 0:
                print(f"{len(rows)} of {len(seeds)}", file=sys.stderr, flush=True)
    held = sum((Counter(row.held) for row in rows), Counter[str]())
    print(f"{len(rows)} logs: {dict(Counter(row.ended for row in rows))}; {sum(held.values())} statements held")
    for what, count in sorted(held.items()):
        print(f"  {count:7d}  {what}")
    for what, count in sorted(sum((Counter(row.unchecked) for row in rows), Counter[str]()).items()):
        print(f"  {count:7d}  not checked, the log being too large: {what}")
    kinds: dict[str, list[tuple[Row, str]]] = {}
    for row in rows:
        for failure in row.failures:
            kinds.setdefault(failure["kind"], []).append((row, failure["detail"]))
    for what, cases in sorted(kinds.items(), key=lambda item: -len(item[1])):
        print(f"FAILED {len({r.seed for r, _ in cases})} logs: {what}")
        print(f"       seeds {list(dict.fromkeys((r.seed, r.drive) for r, _ in cases))[:8]}")
        print(f"       {cases[0][1][:300]}")
    slowest = sorted(rows, key=lambda row: -row.seconds)[:5]
    print("slowest: " + ", ".join(f"seed {r.seed} ({r.drive}) {r.seconds:.1f} s" for r in slowest))
    return rows


def renew(workers: int) -> None:
    """What fails of the suite's own logs, written where the suite knows it from; and what has changed since."""
    found = {("small", row.seed): row for row in campaign(range(FIRST, FIRST + SMALL), Kind(), None, workers)}
    middle = campaign(range(FIRST, FIRST + MIDDLE), Kind(middle=True), None, workers)
    found |= {("middle", row.seed): row for row in middle}
    teams = campaign(range(FIRST, FIRST + TEAMS), Kind(teams=True), None, workers)
    found |= {("team", row.seed): row for row in teams}
    for name, count in HANDFUL.items():
        rows = campaign(range(FIRST, FIRST + count), Kind(real=True, name=name), None, 1)
        found |= {(name, row.seed): row for row in rows}
    kinds = {log: tuple(sorted({f["kind"] for f in row.failures})) for log, row in found.items() if row.failures}
    print(f"no longer fail: {sorted(set(KNOWN) - set(kinds))}")
    print(f"fail now: {sorted(set(kinds) - set(KNOWN))}")
    stress_page.write_known(KNOWN_FILE, kinds)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=1)
    parser.add_argument("--drive", choices=sorted({*DRIVES, *DRIVEN}))
    parser.add_argument("--rows", type=heard)
    parser.add_argument("--middle", action="store_true")
    parser.add_argument("--teams", action="store_true")
    parser.add_argument("--real", nargs="?", const="any", choices=["any", *LOGS], help="of a published log")
    parser.add_argument("--shrink", action="store_true")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--known", action="store_true")
    parser.add_argument("--page", nargs=5, type=Path, metavar=("PAGE", "SMALL", "MIDDLE", "TEAMS", "REAL"))
    given = parser.parse_args()
    kind = Kind(given.middle, given.teams, bool(given.real), given.real if given.real in LOGS else None)
    if given.page:
        counted = [[asdict(row) for row in rows_of(path)] for path in given.page[1:]]
        stress_page.write(given.page[0], *counted, f"{platform.machine()}, {os.cpu_count()} cores")
        return 0
    if given.known:
        renew(given.workers)
        return 0
    if given.count > 1:
        seeds = range(given.seed, given.seed + given.count)
        rows = campaign(seeds, kind, given.drive, given.workers, given.json)
        return int(any(row.failures for row in rows))
    if given.rows:
        verdict = judge(given.seed, middle=given.middle, drive=given.drive, rows=given.rows)
    else:
        verdict = kind.judge(given.seed, given.drive)
    tell(verdict)
    for failed in {f.kind for f in verdict.findings.failures} if given.shrink else ():
        print(f"\nthe smallest that fails so: {failed}")
        tell(smallest(verdict, failed)[1])
    return int(bool(verdict.findings.failures))


if __name__ == "__main__":
    sys.exit(main())
