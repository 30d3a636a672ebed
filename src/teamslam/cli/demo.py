"""`teamslam demo`: what submap joining gives, on two simulated teams and a filmed one, in about a minute."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from teamslam.cli.numbers import Whole

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.figure import Figure

    from teamslam.config import Config
    from teamslam.model import Dataset
    from teamslam.pipeline import Progress
    from teamslam.results import Record

FILM_S, FILM_HZ = 30.0, 1.0  # of the film: two rounds, and drawn in half a minute


def demo(
    *,
    out: Path = Path("demo"),
    seed: Whole = 1,
) -> int:
    """Simulate two teams and film a third, map them by joining and by full least squares, and draw what comes out.

    First the paper's world: three robots, three landmarks. Then a larger team. Then the paper's experiment, from the
    images of two robots (needs `pip install teamslam[tags]`, and is left out without). No robot knows where the
    others started.

    ```
    teamslam demo
    teamslam demo --out somewhere --seed 7
    ```

    Exit codes: 0 done; 1 a map did not converge, or came in several parts; 2 bad input or usage.

    Parameters
    ----------
    out
        The folder to write; an earlier demo in it is replaced.
    seed
        Of everything that is drawn.
    """
    from teamslam.cli.codes import DONE, code_of
    from teamslam.cli.console import answer, progress_bar, say, table
    from teamslam.errors import MissingExtraError
    from teamslam.pipeline import run
    from teamslam.results import made_folder, write_run
    from teamslam.results.figures import save
    from teamslam.results.words import comparison

    made_folder(out)
    code, drawn, every, reports = DONE, {}, [], {}
    teams = demo_teams(seed)
    try:
        with progress_bar() as progress:
            teams["film"] = "The experiment, filmed", filmed_team(seed, progress)
    except MissingExtraError as missing:
        say(f"left out, the paper's experiment on film: {missing}")
    for name, (kind, dataset) in teams.items():
        records = {}
        for method, options in demo_methods().items():
            with progress_bar() as progress:
                result = run(dataset, options, progress)
            records[method] = write_run(result, out / f"{name}-{method}", replace=True, figures=method == "joined")
            code = max(code, code_of(records[method].report))
        title = f"{kind}: {what_went_in(records['joined'].report)}"
        table(title, *comparison(records))
        drawn[title] = records["joined"]
        reports[name] = {method: record.report for method, record in records.items()}
        every.append({method: record.report["cost"] for method, record in records.items()})
    save(overview(drawn), out / "demo.png")
    say(what_next(out, every))
    answer({"written": str(out), "teams": reports})
    return code


def what_went_in(report: "Mapping[str, Any]") -> str:
    """How large a team is."""
    from teamslam.results.words import counted

    return counted(report["robots"], "robot", report["poses"], "pose", report["landmarks"], "landmark")


def what_next(out: Path, costs: "Sequence[Mapping[str, float]]") -> str:
    """What was shown, where to look, and what to try."""
    near = all(found["joined"] < 1.1 * found["full"] for found in costs)
    same = all(abs(found["exact"] - found["full"]) < 1e-6 * found["full"] for found in costs)
    small = "comes close to" if near else "is here some way from"
    rounds = "reaches it" if same else "reaches an optimum too, here another one"
    return f"""Shown: joining small submaps, exchanged once, {small} solving for everything at once ("full"), and
joining in rounds ("exact") {rounds}; cost counts all measurements, and NEES / dof near 1 means honest covariances.
Look at  {out / "demo.png"}, then at the figures in {out / "team-joined"}
Next     teamslam simulate my-team && teamslam run my-team --out my-map
         teamslam run MRCLAM_Dataset6 --out real      five real robots (data: see README)
         teamslam --help"""


def demo_teams(seed: int) -> "dict[str, tuple[str, Dataset]]":
    """A name, what it is in words, and a log for each team."""
    from teamslam.sim import Options, PaperOptions, simulate

    paper = PaperOptions("sufficient", poses=12, sigma_observation=0.1, sigma_odometry=0.2)
    large = Options("planar", robots=8, poses=250, landmarks=120)
    return {
        "paper-world": ("The paper's world", simulate(paper, seed)),
        "team": ("A larger team", simulate(large, seed)),
    }


def filmed_team(seed: int, progress: "Progress") -> "Dataset":
    """What two robots filmed in the virtual lab, their clocks and cameras as they are. MissingExtraError where nothing
    can be filmed."""
    from dataclasses import replace
    from tempfile import TemporaryDirectory

    from teamslam.cli.film import write_film
    from teamslam.io import read
    from teamslam.sim.film import PRESETS, film

    options = replace(PRESETS["experiment"], seconds=FILM_S, images_hz=FILM_HZ)
    with TemporaryDirectory() as folder:
        write_film(film(options, seed), Path(folder) / "film", "mcap", progress)
        log = read(Path(folder) / "film" / "team.toml")
    return replace(log, unknowns=None, origin="film")


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
        columns=3,
    )
