"""`teamslam.plot`: a figure of a team's map, or of whatever has one."""

from dataclasses import replace
from typing import TYPE_CHECKING

from teamslam.errors import ModelError
from teamslam.joining import Joined
from teamslam.model import Dataset, Submap, Values, a_kind
from teamslam.pipeline import Result
from teamslam.results.errors import truth_by_team
from teamslam.results.figures import regions_of, scene_of
from teamslam.results.record import Record, robot_sightings
from teamslam.solver import Covariances
from teamslam.viz import Scene, draw_map, draw_maps

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot(team: Joined | Result | Record | Submap, *, title: str = "", truth: Values | None = None) -> "Figure":
    """A figure of a map: ways, landmarks with 95 % regions, sightings, and the truth where it is known.

    `team` is a join, a run, a run read back, or a submap; of several maps there is a panel for each. `truth`, in any
    frame, is drawn beside the map. A new matplotlib Figure, neither shown nor saved: notebooks show it, `savefig` saves
    it. ModelError for anything else.
    """
    scenes = [_with(scene, title, truth) for scene in _scenes(team)]
    if len(scenes) == 1:
        return draw_map(scenes[0])
    return draw_maps(
        {f"part {n}": scene for n, scene in enumerate(scenes, 1)}, title or "Maps that could not be joined"
    )


def _scenes(team: object) -> list[Scene]:
    if isinstance(team, Result | Record):
        record = team if isinstance(team, Record) else Record.of(team)
        return [scene_of(record, number) for number in range(len(record.maps))]
    if isinstance(team, Submap):
        return [Scene(team, regions_of(team, Covariances.of_map(team)), title=f"Submap {team.id}")]
    if isinstance(team, Joined):
        pairs = zip(team.maps, team.covariances, strict=True)
        bare = [Scene(submap, regions_of(submap, covariances)) for submap, covariances in pairs]
        log = team.log
        if log is None:
            return bare
        return [_with(replace(scene, sightings=robot_sightings(log)), "", log.truth) for scene in bare]
    wish = "; a log has no map yet: plot(ts.run(log))" if isinstance(team, Dataset) else ""
    raise ModelError(f"expected a map (of ts.join, ts.full, ts.run or ts.build), found {a_kind(team)}{wish}")


def _with(scene: Scene, title: str, truth: Values | None) -> Scene:
    """A scene under another title and with another truth, where these are given."""
    known = scene.truth if truth is None else truth_by_team(scene.map, truth)
    return replace(scene, title=title or scene.title, truth=known)
