"""`teamslam demo`: what submap joining gives, on two simulated teams, in under a minute."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from teamslam.config import Config
    from teamslam.model import Dataset
    from teamslam.results import Record


def demo(
    *,
    out: Path = Path("demo"),
    seed: int = 1,
    quiet: Annotated[bool, Parameter(name=["--quiet", "-q"], negative="")] = False,
) -> int:
    """Simulate two teams, map them by joining and by full least squares, and draw what comes out.

    First the paper's world: three robots, three landmarks. Then a larger team. No robot knows where the others
    started.

    ```
    teamslam demo
    teamslam demo --out somewhere --seed 7
    ```

    Exit codes: 0 done; 1 a map did not converge; 2 bad input or usage.

    Parameters
    ----------
    out
        The folder to write; an earlier demo in it is replaced.
    seed
        Of everything that is drawn.
    quiet
        Print nothing but errors.
    """
    from teamslam.cli.console import progress_bar, say, table
    from teamslam.cli.words import comparison
    from teamslam.pipeline import run
    from teamslam.results import write_run

    out.mkdir(parents=True, exist_ok=True)
    converged, drawn = True, {}
    for name, (title, dataset) in demo_teams(seed).items():
        records = {}
        for method, options in demo_methods().items():
            with progress_bar(quiet) as progress:
                result = run(dataset, options, progress)
            records[method] = write_run(result, out / f"{name}-{method}", replace=True, figures=method == "joined")
            converged &= result.joined.converged and len(result.joined.components) == 1
        if not quiet:
            table(title, *comparison(records))
        drawn[title] = records["joined"]
    overview(drawn).savefig(out / "demo.png")
    if not quiet:
        say(what_next(out))
    return 0 if converged else 1


def what_next(out: Path) -> str:
    """What was shown, where to look, and what to try."""
    return f"""Shown: joining small submaps, exchanged once, comes close to solving for everything at once ("full"), and
joining in rounds ("exact") reaches it; cost counts all measurements, and NEES / dof near 1 means honest covariances.
Look at  {out / "demo.png"}, then at the figures in {out / "team-joined"}
Next     teamslam simulate my-team && teamslam run my-team --out my-map
         teamslam run MRCLAM_Dataset6 --out real      five real robots (data: see README)
         teamslam --help"""


def demo_teams(seed: int) -> "dict[str, tuple[str, Dataset]]":
    """A name, a title and a log for each team."""
    from teamslam.sim import Options, PaperOptions, simulate

    paper = PaperOptions("sufficient", poses=12, sigma_observation=0.1, sigma_odometry=0.2)
    large = Options("planar", robots=8, poses=250, landmarks=120)
    return {
        "paper-world": ("The paper's world: 3 robots, 3 landmarks", simulate(paper, seed)),
        "team": ("A larger team: 8 robots, 2,000 poses, 120 landmarks", simulate(large, seed)),
    }


def demo_methods() -> "dict[str, Config]":
    """The options of each method that is compared."""
    from teamslam.config import Config, JoinOptions

    return {"joined": Config(), "exact": Config(join=JoinOptions(exact=True)), "full": Config(method="full")}


def overview(records: "dict[str, Record]") -> "Figure":
    """The joined maps of all teams in one figure."""
    from teamslam.results.figures import scene_of
    from teamslam.viz import draw_maps

    return draw_maps(
        {title: scene_of(record, 0) for title, record in records.items()},
        title="Submap joining: several robots, one map, no known start",
    )
