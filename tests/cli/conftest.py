"""Calling the command line inside the test's process: what it printed, and its exit code."""

from collections.abc import Callable
from dataclasses import dataclass

import pytest


@dataclass(frozen=True)
class Called:
    """What came of a call."""

    code: int
    out: str
    err: str


@pytest.fixture
def teamslam(capsys: pytest.CaptureFixture[str]) -> Callable[..., Called]:
    """teamslam("run", path, "--out", folder) as on the command line."""
    from teamslam.cli import main

    def call(*arguments: object) -> Called:
        capsys.readouterr()
        try:
            code = main([str(a) for a in arguments])
        except SystemExit as exit_:  # --help and --version
            code = int(exit_.code or 0)
        captured = capsys.readouterr()
        return Called(code, captured.out, captured.err)

    return call
