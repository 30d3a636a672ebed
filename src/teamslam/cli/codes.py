"""Exit codes: what a script is told, in one number.

0    done, whole
1    not of everything: not converged, parts of the team apart, something left out or refused
2    something is wrong with the input, the call or the output; nothing was written
3    a map, but the model grossly misfits the measurements
4    no map: no estimate exists, or none was reached; nothing was written
70   a mistake of teamslam itself, with its traceback (as sysexits has it)
130  interrupted (Ctrl-C), 143 ended (SIGTERM): nothing is left half-written
141  nobody reads what is printed any more (a broken pipe)
"""

from collections.abc import Mapping
from typing import Any

DONE, PARTLY, BAD_INPUT, MISFIT, NO_MAP = 0, 1, 2, 3, 4
BUG = 70
BROKEN_PIPE = 141


def interrupted(signal: int) -> int:
    """The code of a command that a signal ended, as shells count: 130 for Ctrl-C."""
    return 128 + signal


def code_of(report: Mapping[str, Any]) -> int:
    """The code of a run by what its report says: whether the map fits, and whether it is whole."""
    fit = report.get("fit")
    if fit and fit["gross"]:
        return MISFIT
    whole = report["converged"] and report["components"] == 1
    return DONE if whole and not report.get("refused") and not report.get("left_out") else PARTLY
