"""A run as a page: what is drawn of it, and what is told of it in words and tables."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from teamslam.cards import ROBOT_COLOURS
from teamslam.config import Config, config_text
from teamslam.geometry import Array, IntArray
from teamslam.io.files.whole import whole_file
from teamslam.model import Names, Values, chi2_quantile, robot_of
from teamslam.report import Marks, Page, Part, Sightings, Way, html_of, within
from teamslam.results.figures import clocks_figure, headline, png_of, scene_of
from teamslam.results.page_rows import rows_of
from teamslam.results.page_tables import tables_of
from teamslam.results.page_trust import doubted_marks, doubts_in, rejected_rows
from teamslam.results.record import Record
from teamslam.results.words import counted, outcome
from teamslam.viz import Scene, frame_name
from teamslam.viz.scene import CONFIDENCE

PAGE = "report.html"  # in the folder of a run
MOST_POSES = 20_000  # drawn; of more, as many as an eye can tell apart
MOST_REGIONS = 150  # of one robot, along its way
MOST_PARTS = 12  # maps drawn side by side


def write_page(record: Record, config: Config, path: Path) -> None:
    """Write a run's page, whole or not at all. OSError names the file."""
    page = page_bytes(record, config)
    with whole_file(path) as file:
        file.write(page)


def page_bytes(record: Record, config: Config) -> bytes:
    """A run's page as a file holds it."""
    return html_of(page_of(record, config)).encode("utf-8", "replace")


def page_of(record: Record, config: Config) -> Page:
    """All that the page of a run shows."""
    seen = _Seen(record)
    rows, thinned_rows = rows_of(record, seen.robots, seen.start_s)
    fit = record.report.get("fit") or {"verdict": "unknown", "sentence": "nothing is known of how well the map fits"}
    return Page(
        title=headline(record).partition(", part")[0],
        verdict=fit["verdict"],
        sentence=fit["sentence"].removeprefix(f"{fit['verdict']}: "),  # which stands before it, larger
        summary=list(_summary(record)),
        robots=seen.robots,
        colours=ROBOT_COLOURS,
        counts=seen.names.counts,
        parts=[seen.part(number) for number in range(min(len(record.maps), MOST_PARTS))],
        rows=[each for each in rows if each.part < MOST_PARTS],
        rejected=[each for each in rejected_rows(record, seen.robots, seen.start_s) if each.part < MOST_PARTS],
        tables=list(tables_of(record, [scene.truth for scene in seen.scenes], seen.start_s)),
        config=config_text(config),
        thinned=[*seen.thinned(), *thinned_rows],
        alerts=list(_alerts(record.report)),
        pictures=[("Clocks and cameras", png_of(figure)) for figure in clocks_figure(record).values()],
    )


def _alerts(report: Mapping[str, Any]) -> Iterator[str]:
    """Why the map is not all of it, or not to be trusted yet."""
    if not report["converged"]:
        yield f"Not converged: {report['status']}"
    if report["components"] > 1:
        yield f"{report['components']} maps: the team could not be joined into one: {'; '.join(report['reasons'])}"
    lost = report.get("left_out", [])
    if lost:
        more = f", and {len(lost) - 1} more" if len(lost) > 1 else ""
        yield f"Left out: {lost[0]['what']}{more}; the reasons stand below."
    doubts = doubts_in(report)
    if doubts:
        more = f" And {len(doubts) - 1} more; they stand below." if len(doubts) > 1 else ""
        yield f"Not to be believed: {doubts[0]}.{more}"
    if report.get("refused"):
        yield f"{counted(len(report['refused']), 'submap')} refused; the reasons stand below."


def _summary(record: Record) -> Iterator[tuple[str, str]]:
    """What the terminal says of a run, less the verdict and the reader's reasons, which stand elsewhere."""
    heading = ""
    for name, value in outcome(record.report):
        heading = name or heading
        if heading != "fit" and (name or heading != "dropped"):
            yield name, value


@dataclass(frozen=True, eq=False)
class _Seen:
    """A run as a page looks at it: one start of time, one order of robots, one measure of what is too small to see."""

    record: Record

    @property
    def names(self) -> Names:
        return self.record.maps[0].names

    @cached_property
    def scenes(self) -> list[Scene]:
        """What the figures of the maps draw, too."""
        return [scene_of(self.record, number) for number in range(len(self.record.maps))]

    @cached_property
    def robots(self) -> list[str]:
        """Names of the robots of all parts, in order."""
        numbers = sorted({robot for submap in self.record.maps for robot in submap.robots_in_it})
        return [self.names.robot(robot) for robot in numbers]

    @cached_property
    def start_s(self) -> float:
        """The first stamp of all."""
        return min(
            float(m.names.stamps_s(m.trajectory_keys(r)[:1])[0]) for m in self.record.maps for r in m.robots_in_it
        )

    @cached_property
    def poses(self) -> int:
        """How many there are."""
        return sum(len(m.trajectory_keys(r)) for m in self.record.maps for r in m.robots_in_it)

    @cached_property
    def step_m(self) -> float:
        """How far apart poses are drawn: 0 where all are."""
        if self.poses <= MOST_POSES:
            return 0.0
        return sum(_length(m.all_values, m.trajectory_keys(r)) for m in self.record.maps for r in m.robots_in_it) / (
            MOST_POSES
        )

    def thinned(self) -> Iterator[str]:
        """What is drawn in part, in words."""
        if self.step_m > 0.0:
            yield (
                f"Of {self.poses:,} poses those are drawn that begin another {self.step_m:.2g} m of way: "
                f"none is further from what is drawn."
            )
        if len(self.record.maps) > MOST_PARTS:
            yield f"Drawn: the first {MOST_PARTS} of {len(self.record.maps)} maps."

    def part(self, number: int) -> Part:
        """One map."""
        scene, part = self.scenes[number], self.record.report["parts"][number]
        who = f"robot{'s' * (len(part['robots']) != 1)} {_listed(part['robots'])}"
        held = counted(part["poses"], "pose", part["landmarks"], "landmark")
        weakest, weakest_times = scene.weakest(3)
        several = f"Part {number + 1} of {len(self.record.maps)}: " if len(self.record.maps) > 1 else ""
        return Part(
            title=f"{several}{who}: {held}",
            frame=frame_name(scene),
            spatial=scene.is_spatial,
            magnification=scene.magnification(3 if scene.is_spatial else 2),
            quantile=float(chi2_quantile(CONFIDENCE, 3 if scene.is_spatial else 2)),
            ways=[self._way(scene, number, robot) for robot in scene.robots],
            marks=_marks(scene, doubted_marks(self.record)),
            sightings=self._sightings(scene),
            weakest=weakest,
            weakest_times=weakest_times,
        )

    def _way(self, scene: Scene, number: int, robot: int) -> Way:
        submap = scene.map
        every = submap.trajectory_keys(robot)
        keys = every[within(submap.all_values.positions(every, 3), self.step_m)]
        poses = submap.all_values.poses_of(keys, 3)
        some = keys[:: -(-len(keys) // MOST_REGIONS)]
        known = some[some != submap.base]
        blocks = self.record.covariances[number].blocks(known)
        regions = replace(scene, covariances=dict(zip(known.tolist(), blocks, strict=True))).regions(known, 3)[1]
        return Way(
            robot=self.robots.index(submap.names.robot(robot)),
            all=len(every),
            stamps=self._since(submap.names, keys),
            places=poses.translation,
            forward=poses.rotation[:, :, 0],
            truth=_truth(scene, keys),
            region_stamps=self._since(submap.names, known),
            regions=regions,
        )

    def _sightings(self, scene: Scene) -> Sightings:
        """Of robots by robots, rising in the later stamp."""
        pairs, _ = scene.visible_sightings(MOST_POSES)
        stamps = self._since(scene.map.names, pairs)
        order = np.argsort(stamps.max(-1), kind="stable") if len(pairs) else np.zeros(0, np.int64)
        numbers, which = np.unique(robot_of(pairs[order]), return_inverse=True)
        place = np.array([self.robots.index(scene.map.names.robot(int(n))) for n in numbers], np.int64)
        return Sightings(place[which.reshape(-1, 2)] if len(pairs) else np.zeros((0, 2), np.int64), stamps[order])

    def _since(self, names: Names, keys: IntArray) -> Array:
        return np.asarray(names.stamps_s(keys), float) - self.start_s


def _marks(scene: Scene, doubted: Sequence[str]) -> Marks:
    submap, keys = scene.map, scene.map.landmark_keys
    names = [submap.names.landmark(int(key)) for key in keys]
    return Marks(
        names=names,
        doubted=np.isin(np.array(names, object), doubted) if len(names) else np.zeros(0, bool),
        places=submap.all_values.positions(keys, 3),
        covariances=scene.regions(keys, 3)[1],
        truth=_truth(scene, keys),
        second=scene.second_places(keys),
    )


def _truth(scene: Scene, keys: IntArray) -> Array:
    """Where variables truly are (n, 3), nan where nobody knows."""
    found = np.full((len(keys), 3), np.nan)
    if scene.truth is not None and len(keys):
        known = np.asarray(scene.truth.layout.contains(keys))
        found[known] = scene.truth.positions(keys[known], 3)
    return found


def _length(values: Values, keys: IntArray) -> float:
    return float(np.linalg.norm(np.diff(values.positions(keys, 3), axis=0), axis=-1).sum())


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")
