"""`teamslam plan`: what a team will know, before it drives."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from teamslam.cli.numbers import Whole

if TYPE_CHECKING:
    from collections.abc import Sequence

    from teamslam.model import Dataset
    from teamslam.trust.foresee import Foreseen, Tag


def plan(
    mission: Path | None = None,
    /,
    *,
    preset: str | None = None,
    seed: Whole = 0,
    out: Path | None = None,
    figures: bool = True,
) -> int:
    """Say what a team will know if it drives as planned: where tags are missing, and what would hang loose.

    The Cramer-Rao bound along the ways, no estimate can be better; what nothing ties together; what will be known
    least; which sightings, and which one more landmark, would help most.

    ```
    teamslam plan mission.toml
    teamslam plan mission.toml --out plan       # and plan/plan.json, plan/plan.png
    teamslam plan my-team                       # a log with truth: what its sightings can tell
    teamslam plan --preset lidar --seed 3
    ```

    A mission in TOML:

    ```
    speed_m_s = 0.5
    period_s = 1.0
    [[robot]]
    name = "red"
    way = [[0, 0], [8, 0], [8, 5]]                  # corners, in metres
    landmarks = { model = "range_bearing", range_m = 6.0 }
    robots = false                                  # it sees no other robots
    [[landmark]]
    name = "door"
    at = [2.0, 3.5]
    ```

    Exit codes: 0 done; 1 something would hang loose or be seen by nobody; 2 bad input or usage.

    Parameters
    ----------
    mission
        A mission (.toml), or a log with the truth (or initial values) of all that it names, in any format that
        `teamslam convert --help` lists.
    preset
        A made-up world of `teamslam simulate` instead.
    seed
        Of the made-up world.
    out
        A folder to write plan.json and plan.png into.
    figures
        Draw the figure.
    """
    from teamslam.cli.codes import DONE, PARTLY
    from teamslam.cli.console import answer, pairs, say
    from teamslam.results.whole import refuse_to_overwrite
    from teamslam.trust.foresee import foresee, place_next
    from teamslam.trust.foresee.report import report_of
    from teamslam.trust.weak.eyes import eyes_of
    from teamslam.trust.weak.sightings import look_next

    if out is not None:
        refuse_to_overwrite(out, replace=None)
    dataset, landmarks = _planned(mission, preset, seed)
    found = foresee(dataset, landmarks)
    sightings = look_next(found.weak, eyes_of(dataset.tables, found.values))
    tags = place_next(found, dataset)
    for sentence in found.sentences:
        say(sentence)
    for title, advice in (
        ("What to look at", [sighting.sentence for sighting in sightings]),
        ("Where to put a tag", [tag.sentence for tag in tags]),
    ):
        if advice:
            pairs(title, [(str(number), said) for number, said in enumerate(advice, start=1)])
    report = report_of(found, sightings, tags)
    answer(report)
    if out is not None:
        _write(out, report, found, tags, figures)
        say(f"written: {out}")
    return PARTLY if found.weak.open or found.unseen else DONE


def _planned(mission: Path | None, preset: str | None, seed: int) -> "tuple[Dataset, dict[int, str] | None]":
    """What the team would measure, and all landmarks that were planned, where that is known."""
    from teamslam.errors import InputError
    from teamslam.io import read
    from teamslam.sim import simulate
    from teamslam.trust.foresee import read_mission

    if (mission is None) == (preset is None):
        raise InputError("give a mission (or a log with truth), or --preset, one of them")
    if preset is not None:
        return simulate(preset, seed), None
    assert mission is not None
    if mission.suffix.lower() == ".toml":
        plan = read_mission(mission)
        return plan.dataset(), plan.named_landmarks
    return read(mission), None


def _write(out: Path, report: "dict[str, Any]", found: "Foreseen", tags: "Sequence[Tag]", figures: bool) -> None:
    import json

    from teamslam.results.whole import whole_folder
    from teamslam.trust.foresee.report import map_of
    from teamslam.viz import Scene, draw_plan, saved

    with whole_folder(out) as draft:
        (draft / "plan.json").write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
        if figures:
            scene = Scene(map_of(found), found.covariances)
            places = {f"tag {n}": tag.at for n, tag in enumerate(tags, 1)}
            with (draft / "plan.png").open("wb") as file:
                saved(draw_plan(scene, places), file)
