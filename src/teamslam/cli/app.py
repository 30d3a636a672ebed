"""`teamslam`: the commands together, and what becomes of errors.

An error that teamslam raises on purpose is one message on stderr; anything else is a bug, and shows its traceback.
"""

from collections.abc import Sequence

from cyclopts import App, CycloptsError, UnusedCliTokensError

from teamslam import __version__
from teamslam.cli.build import build
from teamslam.cli.calibrate import calibrate
from teamslam.cli.codes import BAD_INPUT, BUG, DONE, NO_MAP
from teamslam.cli.console import complain, screen
from teamslam.cli.convert import convert
from teamslam.cli.data import data
from teamslam.cli.demo import demo
from teamslam.cli.exchange import exchange
from teamslam.cli.film import film
from teamslam.cli.info import info
from teamslam.cli.join import join
from teamslam.cli.keys import keys
from teamslam.cli.paper import paper
from teamslam.cli.plan import plan
from teamslam.cli.plot import plot
from teamslam.cli.robot import robot
from teamslam.cli.run import run
from teamslam.cli.score import score
from teamslam.cli.simulate import simulate
from teamslam.cli.split import split
from teamslam.cli.status import status
from teamslam.cli.team import team
from teamslam.cli.view import view
from teamslam.cli.voice import spoken
from teamslam.errors import SolveError, TeamslamError

HELP = """Several robots, one map: landmark SLAM for teams by submap joining.

Start here:

```
teamslam demo                            # simulated teams, figures in ./demo
teamslam info MRCLAM_Dataset6            # what a log holds and what is wrong
teamslam run MRCLAM_Dataset6 --out map   # map, covariances, errors, figures
```

Every command explains itself, with examples: `teamslam run --help`.

Exit codes: 0 done; 1 not converged, in parts, or something left out; 2 bad input or usage; 3 a map that its
measurements contradict; 4 no map at all; 70 a mistake of teamslam; 130 interrupted; 141 nobody reads the output.

Shell completion: `teamslam --install-completion`.
"""

app = App(name="teamslam", help=HELP, version=__version__, help_format="markdown", version_flags=["--version"])
app.register_install_completion_command(help="Install completion of commands and options for this shell.")
STORY = (demo, run, plan, simulate, film, calibrate, convert, info, score, plot, view, paper)
PARTS = (split, build, join, exchange, robot, team, status, keys)
for command in (*STORY, *PARTS):
    app.command(spoken(command))
app.command(data)


def _said(error: CycloptsError) -> str:
    """What is wrong with a command as it was typed."""
    if isinstance(error, UnusedCliTokensError) and error.unused_tokens:
        return f"the command does not take {' and '.join(error.unused_tokens)}"
    return str(error).strip().removesuffix(".")


def called(arguments: Sequence[str] | None) -> int:
    """Run one command and return its exit code; `arguments` None takes those of the process."""
    try:
        command, bound, _ = app.parse_args(arguments, console=screen(), exit_on_error=False, print_error=False)
        return command(*bound.args, **bound.kwargs) or DONE
    except CycloptsError as error:
        said = _said(error)
        end = "" if said.endswith("?") else "."
        complain(f"{said}{end} See: teamslam {' '.join([*(error.command_chain or ()), '--help'])}")
        return BAD_INPUT
    except SolveError as error:
        complain(str(error))
        return NO_MAP
    except TeamslamError as error:
        complain(str(error))
        return BAD_INPUT
    except MemoryError as error:
        complain(f"not enough memory: {error or 'the problem is too large for this machine'}")
        return BAD_INPUT
    except BrokenPipeError:
        raise
    except OSError as error:
        complain(f"{error.filename or 'the output'}: {error.strerror or error}")
        return BAD_INPUT
    except Exception:
        import traceback

        traceback.print_exc()
        complain("this is a mistake of teamslam itself; please report it with the lines above")
        return BUG
