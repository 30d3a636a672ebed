"""A log, all of it: made, driven, checked; and the smallest part of it that still fails in the same way."""

from collections.abc import Iterator
from dataclasses import dataclass

from stress.account import check_account
from stress.claims import check_sentences
from stress.commands import check_command
from stress.drive import DRIVES, Outcome, drive_of, go
from stress.failure import Findings
from stress.files import check_files, is_same
from stress.maps import check_maps
from stress.near import check_near
from stress.oracle import Oracle
from stress.real import DRIVEN, Find, Variation, vary
from stress.reports import check_reports
from stress.scenario import Scenario, draw
from stress.teams import Team, draw_team, log_of_team
from stress.truth import check_truth
from stress.whole import check_whole
from stress.world import chosen, log_of
from teamslam.model import Dataset

MISLED = ("outliers", "wrong", "flipped", "stiff", "one place", "weak")  # faults under which noise is not as stated
Rows = dict[tuple[int, str], set[int]]


@dataclass(frozen=True, eq=False)
class Verdict:
    """What became of one seed's log."""

    scenario: Scenario | Variation | Team
    drive: str
    outcome: Outcome
    findings: Findings


def judge(seed: int, *, middle: bool = False, drive: str | None = None, rows: Rows | None = None) -> Verdict:
    """The verdict on a seed's log, or on some of its rows."""
    scenario = draw(seed, middle=middle)
    log = log_of(scenario)
    return judge_log(scenario, log if rows is None else chosen(log, rows), drive or drive_of(seed))


def judge_team(seed: int, *, drive: str | None = None) -> Verdict:
    """The verdict on a seed's team."""
    team = draw_team(seed)
    return judge_log(team, log_of_team(team), drive or team.drive)


def judge_log(scenario: Scenario | Team, log: Dataset, drive: str) -> Verdict:
    """The verdict on a log of a scenario by a drive."""
    outcome, findings = go(log, DRIVES[drive]), Findings()
    oracle = Oracle(outcome.log)
    fair = isinstance(scenario, Scenario) and is_fair(scenario) and is_same(outcome)
    check_files(outcome, findings)
    check_whole(outcome, findings)
    check_sentences(outcome, oracle, findings)
    check_account(outcome, oracle, findings)
    check_maps(outcome, findings, fair=fair)
    check_truth(outcome, findings)
    check_reports(outcome, findings, fair=fair or isinstance(scenario, Team))
    if DRIVES[drive].by_command and outcome.written is None:
        check_command(outcome, findings)
    return Verdict(scenario, drive, outcome, findings)


def judge_real(seed: int, find: Find, *, name: str | None = None, drive: str | None = None) -> Verdict:
    """The verdict on a seed's variation of a published log."""
    variation, log, drawn = vary(seed, find, name)
    drive = drive or drawn
    outcome, findings = go(log, DRIVEN[drive]), Findings()
    check_files(outcome, findings)
    check_whole(outcome, findings)
    oracle = Oracle(outcome.log)
    check_sentences(outcome, oracle, findings)
    check_account(outcome, oracle, findings)
    check_maps(outcome, findings, fair=False)
    check_near(outcome, findings)
    check_reports(outcome, findings, fair=False)
    if DRIVEN[drive].by_command and outcome.written is None:
        check_command(outcome, findings)
    return Verdict(variation, drive, outcome, findings)


def is_fair(scenario: Scenario) -> bool:
    """Whether noise is what it is stated to be, small, and nothing is forgiven."""
    return (
        scenario.noise in ("fine", "tiny")
        and all(s.loss.name == "squared" for s in scenario.senses)
        and not any(word in fault for fault in scenario.faults for word in MISLED)
    )


def smallest(verdict: Verdict, kind: str) -> tuple[Dataset, Verdict]:
    """A part of a log that fails in the same way, and of which no robot, half or row can be left out any more."""
    assert isinstance(verdict.scenario, Scenario)
    log = log_of(verdict.scenario)
    rows = rows_in(log)
    best = verdict
    shrinking = True
    while shrinking:
        shrinking = False
        for fewer in _fewer(rows):
            part = chosen(log, fewer)
            if not part.tables:
                continue
            try:
                found = judge_log(verdict.scenario, part, verdict.drive)
            except Exception:
                continue  # a part of which the oracle cannot speak
            if any(f.kind == kind for f in found.findings.failures):
                rows, best, shrinking = fewer, found, True
                break
    return chosen(log, rows), best


def rows_in(log: Dataset) -> Rows:
    """All rows of a log, by robot and source."""
    rows: Rows = {}
    for table in log.tables:
        rows.setdefault((table.robot, table.source), set()).update(int(n) for n in table.ids)
    return rows


def _fewer(rows: Rows) -> Iterator[Rows]:
    """Smaller sets of rows, large cuts first."""
    robots = sorted({robot for robot, _ in rows})
    for robot in robots if len(robots) > 1 else []:
        yield {who: of for who, of in rows.items() if who[0] != robot}
    for who in sorted(rows):
        yield {other: of for other, of in rows.items() if other != who}
    for who, of in sorted(rows.items()):
        ordered, size = sorted(of), max(len(of) // 2, 1)
        while size:
            for at in range(0, len(ordered), size):
                left = set(ordered[:at] + ordered[at + size :])
                yield {**{o: n for o, n in rows.items() if o != who}, **({who: left} if left else {})}
            size //= 2


def told(rows: Rows) -> str:
    """Rows in one line: 1/odometry:0-3,5 2/robots:0."""
    return " ".join(f"{robot}/{source}:{_spans(of)}" for (robot, source), of in sorted(rows.items()))


def heard(text: str) -> Rows:
    """Rows from one line. Law: heard(told(rows)) == rows."""
    rows: Rows = {}
    for part in text.split():
        who, spans = part.rsplit(":", 1)
        robot, source = who.split("/", 1)
        ends = [[int(n) for n in span.split("-")] for span in spans.split(",")]
        rows[int(robot), source] = {n for span in ends for n in range(span[0], span[-1] + 1)}
    return rows


def _spans(numbers: set[int]) -> str:
    spans: list[list[int]] = []
    for n in sorted(numbers):
        if spans and spans[-1][1] == n - 1:
            spans[-1][1] = n
        else:
            spans.append([n, n])
    return ",".join(f"{a}-{b}" if b > a else f"{a}" for a, b in spans)
