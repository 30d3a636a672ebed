"""teamslam: several robots, one map.

    import teamslam as ts

    dataset = ts.read("MRCLAM_Dataset6")
    submaps = [ts.build(piece) for piece in ts.split(dataset)]
    team = ts.join(submaps)
    print(ts.score(team.map, dataset.truth))

    team.landmark("7"), team.trajectory("1"), team.covariance("7", "1@first")     # asked by name

| name                          | what it is                                                            |
|-------------------------------|-----------------------------------------------------------------------|
| read, write                   | logs from and to files: read(path) -> Dataset                         |
| read_submaps, write_submaps   | finished submaps and maps from and to files                           |
| simulate                      | a team in a made-up world, with its truth                             |
| split, build, join            | a log in pieces, a submap of each (Algorithm 1), one map (Algorithm 2)|
| full                          | full least squares over all measurements: the baseline                |
| score                         | a map against the truth                                               |
| verdict                       | whether the model fits the log, and if not, what it looks like        |
| run, Config                   | all of this in one call, and its options                              |
| plot                          | a figure of a map                                                     |
| write_run, read_run           | a run as a folder of files, and back                                  |
| Dataset, Table, Values        | what was seen, and estimates                                          |
| Submap, Joined, Covariances   | maps, what a join gives, and how sure it is                           |
| Verdict                       | how well a map fits, in all and part by part                          |
| Pose, Loss                    | rigid body poses; how strongly a sighting may pull                    |
| TeamslamError                 | every error that is raised on purpose                                 |

Each name is imported when it is first used, so that `import teamslam` is quick.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from teamslam.config import Config
    from teamslam.errors import TeamslamError
    from teamslam.geometry import Pose
    from teamslam.io import read, read_submaps, write, write_submaps
    from teamslam.joining.build.build import build
    from teamslam.joining.build.split import split
    from teamslam.joining.exact.full import full
    from teamslam.joining.join.join import Joined, join
    from teamslam.metrics import score
    from teamslam.model import Dataset, Loss, Submap, Table, Values
    from teamslam.pipeline import run
    from teamslam.results import plot, read_run, write_run
    from teamslam.sim import simulate
    from teamslam.solver import Covariances
    from teamslam.trust import Verdict, verdict

__all__ = [
    "Config",
    "Covariances",
    "Dataset",
    "Joined",
    "Loss",
    "Pose",
    "Submap",
    "Table",
    "TeamslamError",
    "Values",
    "Verdict",
    "build",
    "full",
    "join",
    "plot",
    "read",
    "read_run",
    "read_submaps",
    "run",
    "score",
    "simulate",
    "split",
    "verdict",
    "write",
    "write_run",
    "write_submaps",
]

_HOMES = {
    "teamslam.config": ("Config",),
    "teamslam.errors": ("TeamslamError",),
    "teamslam.geometry": ("Pose",),
    "teamslam.io": ("read", "read_submaps", "write", "write_submaps"),
    "teamslam.joining": ("Joined", "build", "full", "join", "split"),
    "teamslam.metrics": ("score",),
    "teamslam.model": ("Dataset", "Loss", "Submap", "Table", "Values"),
    "teamslam.pipeline": ("run",),
    "teamslam.results": ("plot", "read_run", "write_run"),
    "teamslam.sim": ("simulate",),
    "teamslam.solver": ("Covariances",),
    "teamslam.trust": ("Verdict", "verdict"),
}
_HOME_OF = {name: module for module, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"teamslam has no '{name}'; it offers {', '.join(__all__)}")
    value = getattr(import_module(_HOME_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
