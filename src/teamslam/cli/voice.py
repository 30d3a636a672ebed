"""How much a command says, the same for every command: --quiet, --verbose, --json.

`spoken` gives them to a command, which need not know: what it prints goes through `console`, which asks here.
"""

import inspect
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import wraps
from platform import python_version
from time import perf_counter
from typing import Annotated, Any

from cyclopts import Parameter


@Parameter(name="*")
@dataclass(frozen=True)
class Voice:
    """How much is said: results, without them nothing but errors, and with them what is going on."""

    quiet: Annotated[bool, Parameter(name=["--quiet", "-q"], negative="", help="Print nothing but errors.")] = False
    verbose: Annotated[
        bool,
        Parameter(name=["--verbose", "-v"], negative="", help="Say on stderr what is going on, and how long it took."),
    ] = False
    json: Annotated[
        bool, Parameter(name="--json", negative="", help="Print the results as one JSON document in place of tables.")
    ] = False


NORMAL = Voice()
_voice: ContextVar[Voice] = ContextVar("voice", default=NORMAL)


def voice() -> Voice:
    """The voice of the command that is running."""
    return _voice.get()


@contextmanager
def speaking(as_loud: Voice) -> Iterator[None]:
    """Within the block commands speak so."""
    before = _voice.set(as_loud)
    try:
        yield
    finally:
        _voice.reset(before)


def spoken(command: Callable[..., int]) -> Callable[..., int]:
    """A command with the options of a Voice beside its own. One that has its own `quiet` keeps it."""
    signature = inspect.signature(command)
    if "quiet" in signature.parameters:
        return command

    @wraps(command)
    def called(*arguments: Any, voice: Voice = NORMAL, **options: Any) -> int:
        from teamslam import __version__
        from teamslam.cli.console import detail
        from teamslam.errors import InputError

        if voice.quiet and voice.verbose:
            raise InputError("--quiet and --verbose contradict each other; leave one out")
        with speaking(voice):
            began = perf_counter()
            detail(f"teamslam {__version__}: {command.__name__}, with Python {python_version()}")
            code = command(*arguments, **options)
            detail(f"{command.__name__} took {perf_counter() - began:.2f} s")
            return code

    added = inspect.Parameter("voice", inspect.Parameter.KEYWORD_ONLY, default=NORMAL, annotation=Voice)
    called.__signature__ = signature.replace(parameters=[*signature.parameters.values(), added])  # type: ignore[attr-defined]
    called.__annotations__ = command.__annotations__ | {"voice": Voice}
    return called
