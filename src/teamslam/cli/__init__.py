"""The command line: one small file a command, each a thin coat on a function that a script can call too.

What is here is what must stand before anything heavy is imported: a Ctrl-C at any moment is one line and its code, and
so are a pipe that nobody reads any more and a terminal that knows no letters beyond ASCII.
"""

import atexit
import gc
import os
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from types import FrameType

from teamslam.cli.codes import BAD_INPUT, BROKEN_PIPE, interrupted

__all__ = ["main"]

SELDOM = (100_000, 20, 100)  # a command makes few circles of objects, and much that there would be to look through


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code; `arguments` None takes those of the process."""
    caught: list[int] = []

    def stop(number: int, frame: FrameType | None) -> None:
        caught.append(number)
        raise KeyboardInterrupt

    before = {number: signal.signal(number, stop) for number in _signals()}
    thresholds = gc.get_threshold()
    try:
        _any_letter()
        gc.set_threshold(*SELDOM)
        atexit.register(gc.freeze)  # else all of a process is looked through at its end, for what goes with it anyway
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # small matrices: its threads spin more than they multiply
        os.environ["MPLBACKEND"] = "agg"  # figures are written, never shown; an unknown name would forbid the import
        from teamslam.cli.app import called

        code = called(arguments)
        sys.stdout.flush()
        return code
    except BrokenPipeError:
        with suppress(OSError, ValueError):  # else Python's last flush fails too
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BROKEN_PIPE
    except OSError as error:  # of the flush: whoever takes what is printed has no room for it
        return _told(f"the output: {error.strerror or error}", BAD_INPUT)
    except BaseException as error:
        # An import that is interrupted may end in whatever error it makes of that.
        if not caught:
            raise
        said = str(error) if isinstance(error, KeyboardInterrupt) else ""
        return _told(said or "interrupted; nothing is left half-written", interrupted(caught[0]))
    finally:
        gc.set_threshold(*thresholds)
        for number, handler in before.items():
            signal.signal(number, handler)


def _signals() -> list[int]:
    """Those that end a command in order; none where this is not the main thread, which alone may listen."""
    import threading

    if threading.current_thread() is not threading.main_thread():
        return []
    return [signal.SIGINT, signal.SIGTERM]


def _any_letter() -> None:
    """Let a terminal without some letter show its code instead, and nobody miss what a closed one would show."""
    sys.stdout = sys.stdout or open(os.devnull, "w")  # noqa: SIM115
    sys.stderr = sys.stderr or open(os.devnull, "w")  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        reconfigure = getattr(stream, "reconfigure", None)
        if reconfigure is not None:
            reconfigure(errors="backslashreplace")


def _told(message: str, code: int) -> int:
    print(f"teamslam: {message}", file=sys.stderr)
    return code
