"""The score of a map against a truth, in one record: for people as a table, for scripts as JSON."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from teamslam.cards import card, curves
from teamslam.errors import in_words
from teamslam.geometry import Pose
from teamslam.metrics.accuracy import Accuracy, PerNumber, Track, accuracy
from teamslam.metrics.consistency import ChiSquare, Consistency, MarginalNees, Marginals, consistency, fit_of
from teamslam.metrics.contradicted import Contradiction, contradicted, told_of
from teamslam.metrics.frames import Aligned, align_team, in_another_world
from teamslam.metrics.in_world import InWorld, in_world, said_of
from teamslam.metrics.likeness import likeness
from teamslam.model import Submap, Values, expect


@dataclass(frozen=True, eq=False)
class Report:
    """How good a map is. Everything about the truth is None (or empty) where the truth does not say.

    `alignment` moves the map onto the truth; `basis` says what it rests on. `fit` needs no truth: it is the squared
    whitened residuals against their degrees of freedom, by the map's own account (a join takes each submap for a
    Gaussian); None where losses forgave some of them. `note` says in words why something is missing, or what makes no
    sense. `contradicted` are landmarks that the truth has elsewhere than all others say. `in_world`, of a map that is
    written in the world's frame, is how far it is off where nothing is aligned.
    """

    map: str
    fit: ChiSquare | None
    alignment: Pose | None = None
    basis: str | None = None
    accuracy: Accuracy | None = None
    consistency: Consistency | None = None
    note: str = ""
    contradicted: tuple[Contradiction, ...] = ()
    in_world: InWorld | None = None

    @property
    def robot_position_rmse_m(self) -> float | None:
        """Of all robots' poses, after one alignment of the whole team [m]."""
        return self.accuracy.robot_position_rmse_m if self.accuracy else None

    @property
    def landmark_rmse_m(self) -> float | None:
        """Of all landmarks, after the same alignment [m]."""
        return self.accuracy.landmark_rmse_m if self.accuracy else None

    @property
    def nees_per_dof(self) -> float | None:
        """Of all variables together; near 1 where the map is as sure as it should be."""
        return self.consistency.nees.per_dof if self.consistency else None

    @property
    def tracks(self) -> tuple[Track, ...]:
        """Errors over time, robot by robot."""
        return self.accuracy.tracks if self.accuracy else ()

    @property
    def headline(self) -> str:
        """The errors in one line, or why there are none."""
        found = (("robots' positions", self.robot_position_rmse_m), ("landmarks", self.landmark_rmse_m))
        said = [f"{what} {value:.4f} m" for what, value in found if value is not None]
        honest = "" if self.nees_per_dof is None else f"; NEES / dof {self.nees_per_dof:.3f}"
        return f"RMSE of {', of '.join(said)}{honest}" if said else self.note or "nothing to compare"

    def __repr__(self) -> str:
        return f"Report({in_words(self.map)}: {in_words(self.headline)})"

    def _repr_html_(self) -> str:
        scored = self.accuracy
        robots = () if scored is None else scored.robots
        facts = [
            (f"robot {r.robot}", f"RMSE {_number(r.position_rmse_m)} m, ATE {_number(r.ate_rmse_m)} m") for r in robots
        ]
        picture = curves([(track.stamps_s, track.position_m) for track in self.tracks])
        return card(f"Errors of map {self.map}", facts, picture=picture, sentence=self.headline)

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON: numbers, words, lists and null. Errors over time are left out."""
        scored, honest = self.accuracy, self.consistency
        return {
            "map": self.map,
            "note": self.note,
            "aligned_on": self.basis,
            "robot_position_rmse_m": self.robot_position_rmse_m,
            "robot_turn_rmse_rad": scored.robot_turn_rmse_rad if scored else None,
            "landmark_rmse_m": self.landmark_rmse_m,
            "rmse_per_number": _fields(scored.per_number) if scored else None,
            "robots": [_fields(r) for r in scored.robots] if scored else [],
            "landmarks": [_fields(m) for m in scored.each_landmark] if scored else [],
            "contradicted": [_fields(m) for m in self.contradicted],
            "in_world": _in_world(self.in_world) if self.in_world else None,
            "pairs": [_fields(p) | {"robots": list(p.robots)} for p in scored.pairs] if scored else [],
            "nees_per_dof": self.nees_per_dof,
            "nees": _chi_square(honest.nees) | {"frame": honest.frame} if honest else None,
            "nees_of_poses": _marginal(honest.of_poses) if honest else None,
            "nees_of_landmarks": _marginal(honest.of_landmarks) if honest else None,
            "chi2": _chi_square(self.fit) if self.fit else None,
        }

    def __str__(self) -> str:
        return "\n".join(_lines(self))


def score(map: Submap, truth: Values, *, covariances: Marginals | None = None) -> Report:
    """A map (or submap) against a truth that knows some of its variables, in any frame.

    `covariances` of the map add the NEES of variables one by one. Laws: score(map, its own values) has no error; moving
    the truth as a whole changes nothing. ModelError where either is something else.
    """
    expect(map, Submap, "a map (a Submap, such as team.map)")
    expect(truth, Values, "a truth (Values, such as log.truth, which is None where the log holds none)")
    aligned = align_team(map, truth)
    found = replace(_compared(map, aligned), fit=fit_of(map))
    if aligned is None or not aligned.held:
        return found
    return replace(
        found,
        consistency=consistency(map, truth, aligned, covariances),
        contradicted=contradicted(aligned, covariances, map.names),
        in_world=in_world(map, aligned, covariances),
    )


def errors_of(map: Submap, truth: Values) -> Report:
    """As `score`, of a map that says nothing of how sure it is: errors alone."""
    return _compared(map, align_team(map, truth))


def _compared(map: Submap, aligned: Aligned | None) -> Report:
    if aligned is None:
        return Report(map.id, None, note="the truth knows none of the map's variables")
    if not aligned.held:
        what = "one place" if len(aligned.keys) == 1 else "places in one line, without orientation,"
        note = f"the truth knows {what} of this map only, which leaves it free to turn: nothing can be compared"
        return Report(map.id, None, note=note)
    note = "; ".join(said for said in ("" if aligned.alike else STRANGERS, likeness(aligned)) if said)
    if in_another_world(map, aligned):
        note = ELSEWHERE.format(aligned.moved_m)
    return Report(
        map=map.id,
        fit=None,
        alignment=aligned.pose,
        basis=aligned.basis,
        accuracy=accuracy(aligned, map.names),
        note=note,
    )


MOST_LANDMARKS = 5  # told one by one in words; all are in `to_dict`
ELSEWHERE = (
    "it is written in another frame than what was measured in the world, {:,.3g} m from there: compared after one "
    "alignment"
)
STRANGERS = (
    "the errors are as large as the map itself. Where its model fits: is this the truth of this team, in this world?"
)


def _fields(record: Any) -> dict[str, Any]:
    return dict(vars(record))


def _chi_square(found: ChiSquare) -> dict[str, Any]:
    band = list(found.band) if found.band else None
    return {"value": found.value, "dof": found.dof, "per_dof": found.per_dof, "band": band, "inside": found.inside}


def _in_world(found: InWorld) -> dict[str, Any]:
    return _fields(found) | {"nees": _chi_square(found.nees), "sentence": said_of(found)}


def _marginal(found: MarginalNees | None) -> dict[str, Any] | None:
    return None if found is None else _fields(found)


def _lines(report: Report) -> Iterator[str]:
    yield f"map {in_words(report.map)}"
    if report.note:
        yield f"  {report.note}"
    if (scored := report.accuracy) is not None:
        yield f"  errors after one alignment of the whole team, on {report.basis}"
        yield f"  compared                 poses {scored.poses}, landmarks {scored.landmarks}"
        yield _row("robot position RMSE", scored.robot_position_rmse_m, "m")
        yield _row("robot orientation RMSE", scored.robot_turn_rmse_rad, "rad")
        yield _row("landmark RMSE", scored.landmark_rmse_m, "m")
        yield from _per_number(scored.per_number)
        yield f"  {'robot':<12} {'poses':>7} {'RMSE m':>9} {'RMSE rad':>9} {'ATE m':>9} {'RPE m':>9} {'RPE rad':>9}"
        for r in scored.robots:
            numbers = (r.position_rmse_m, r.turn_rmse_rad, r.ate_rmse_m, r.rpe_rmse_m, r.rpe_rmse_rad)
            yield f"  {in_words(r.robot):<12} {r.poses:>7} " + " ".join(f"{_number(x):>9}" for x in numbers)
        if scored.each_landmark:
            worst = sorted(scored.each_landmark, key=lambda mark: -mark.position_m)[:MOST_LANDMARKS]
            told = ", ".join(f"{in_words(mark.landmark)} {_number(mark.position_m)} m" for mark in worst)
            yield f"  {'landmarks farthest off':<24} {told}"
        if report.contradicted:
            yield f"  {'truth and map disagree':<24} {told_of(report.contradicted)}"
        if report.in_world:
            yield f"  {'in the world':<24} {said_of(report.in_world)}"
        for p in scored.pairs:
            yield (
                f"  robot {in_words(p.robots[1])} seen from {in_words(p.robots[0])}: RMSE "
                f"{_number(p.position_rmse_m)} m, {_number(p.turn_rmse_rad)} rad"
            )
    if (honest := report.consistency) is not None:
        yield f"  consistency, frame: {FRAMES[honest.frame]}"
        yield _banded("NEES / dof", honest.nees)
        for name, of in (("of poses, one by one", honest.of_poses), ("of landmarks", honest.of_landmarks)):
            if of is not None:
                yield f"  {name:<24} {_number(of.per_dof)}   {of.share_inside:.0%} within their 95 % region"
    if report.fit is not None:
        yield _banded("chi2 / dof, own account", report.fit)


FRAMES = {"base": "the map's base pose", "fitted": "fitted to the truth, its dof taken off", "world": "the world"}


def _per_number(found: PerNumber) -> Iterator[str]:
    yield (
        f"  {'RMSE per number':<24} state {_number(found.state)}, robot poses {_number(found.robot_pose)}, "
        f"landmarks {_number(found.landmark)}"
    )


def _row(name: str, value: float | None, unit: str) -> str:
    return f"  {name:<24} {_number(value)} {unit if value is not None else ''}".rstrip()


def _banded(name: str, found: ChiSquare) -> str:
    if found.per_dof is None or found.band is None:
        return f"  {name:<24} -"
    return f"  {name:<24} {_number(found.per_dof)}   95 % of honest ones: {found.band[0]:.3f} to {found.band[1]:.3f}"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4f}"
