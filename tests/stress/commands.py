"""The same log by the command line: its exit code, what it prints, and the folder that it writes."""

import io
import json
from contextlib import redirect_stderr, redirect_stdout
from math import isclose
from pathlib import Path
from tempfile import TemporaryDirectory

import teamslam as ts
from stress.drive import Outcome
from stress.failure import Findings
from teamslam.cli import main
from teamslam.cli.codes import BAD_INPUT, NO_MAP, code_of
from teamslam.errors import SolveError
from teamslam.results.report import report_of

OPTIONS = {"join": [], "exact": ["--exact"], "full": ["--method", "full"]}


def check_command(outcome: Outcome, findings: Findings) -> None:
    """`teamslam run` on a plain folder does what `run` did: the same figures, or the same sentence and code.

    It reads the very text that the log was read from: a log that is written once more differs in the last digit, and a
    log with several optima may then end in another one.
    """
    assert outcome.file is not None
    with TemporaryDirectory() as name:
        folder = Path(name)
        ts.write(outcome.file.before, folder / "log", format="plain")
        arguments = ["run", str(folder / "log"), "--out", str(folder / "map"), "--no-figures", "--no-calibrate"]
        try:
            code, said = _called([*arguments, *OPTIONS[outcome.method]])
        except Exception as error:
            findings.check(f"a command ends in a traceback: {type(error).__name__}", False, error)
            return
        if outcome.error is not None:
            expected = NO_MAP if isinstance(outcome.error, SolveError) else BAD_INPUT
            findings.check("a command that fails says so in its code", code == expected, f"{code}: {said}")
            findings.check("a command that fails writes nothing", not (folder / "map").exists())
            return
        assert outcome.result is not None
        report = report_of(outcome.result)
        findings.check("a command's code is what its report says", code == code_of(report), f"{code}: {said[-300:]}")
        if not findings.check("a command writes its folder", (folder / "map" / "report.json").is_file(), said[-300:]):
            return
        written = json.loads((folder / "map" / "report.json").read_text(encoding="utf-8"))
        same = all(_same(report[name], written[name]) for name in ("cost", "dof", "components", "status", "reasons"))
        findings.check("a command's report is that of a run", same, written)
        told = " ".join(said.split())
        silent = [reason for reason in report["reasons"] if " ".join(reason.split())[:40] not in told]
        findings.check("a command prints why parts stand apart", not silent, silent)


def _same(one: object, other: object) -> bool:
    if isinstance(one, float) and isinstance(other, float):
        return isclose(one, other, rel_tol=1e-6, abs_tol=1e-6)
    return one == other


def _called(arguments: list[str]) -> tuple[int, str]:
    """The exit code of a command and all that it printed."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        try:
            code = main(arguments)
        except SystemExit as left:
            code = int(left.code or 0)
    return code, out.getvalue() + err.getvalue()
