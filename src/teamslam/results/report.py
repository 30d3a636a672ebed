"""report.json: what a script wants to know of a run, one flat table; null where nobody knows.

Its fields:

    method, exact, order           join or full; whether a join went on in rounds; else in which order it went
    converged, status              how it ended; `status` is a sentence
    cost, chi2, dof                of all measurements at the map: sum of losses; sum of squared whitened residuals (no
                                   factor 1/2, outliers in full); rows - unknowns. cost and chi2 are null where the
                                   measurements themselves are not at hand, as in a join of files without their pieces
    join_cost                      of a join that did not go on in rounds, what it minimised: the cost of the submaps
                                   and what eq. (11) adds to it. Where submaps bend it is not what their map costs
    numbers_measured, numbers_used how many numbers went in, and how many of them speak of variables of one component
                                   alone, so that they are in dof and cost; null where the measurements are not at hand
    iterations, seconds            of the last solve (of its components together); of the whole run, without reading
                                   and writing
    fit                            how well the map fits the measurements: `verdict` (fits, loose, strained, misfit or
                                   unknown), `gross` where the map is not to be trusted, and a `sentence`; `cost` beside
                                   what is `expected`, the `band` that it keeps 999 times of 1000 if the model is right,
                                   and what of it full least squares would take off (`decrease`): a join's own part, or
                                   what it costs rows that they count by how their errors hang together; `causes`, what
                                   a misfit looks like, each with what share of the excess it `explains`; `carriers`,
                                   which sensors, landmarks and stretches of time cost too much; `sensors`, the same of
                                   every sensor of every robot; `noise`, how large the residuals of each part of a
                                   measurement are beside its standard deviation (`scale`), and the share of outliers
    apart                          what landmarks are called otherwise than in the log: each with its `kind` (landmark:
                                   one that was moved, or of which two carry one name, and that is two in the map;
                                   place: what one robot has elsewhere than the others, a landmark of its own; name:
                                   what one robot called by another's name; mount: sensors that sit or look elsewhere
                                   than stated, of which `estimated` says where; and turning: one that turned on its
                                   robot, as `estimated` says), `sentence`, what it `explains` of the excess, and the
                                   `robots` that saw it
    calibration                    what the data showed to be wrong with their model, and what was put right before the
                                   map was made again: `sentences`; `systematic` errors, each with `value`, `sigma` and
                                   `prior`; `scales` of deviations; `slips` of odometry; `lasting`, how errors hang
                                   together in time; `sigmas_m`, what those of landmarks and robots come from.
                                   null where it was not asked for
    estimated                      of sensors that sit elsewhere than stated, where; of recordings, what they rest on
                                   and nobody measured, clocks, latencies, places of cameras and whatever the team file
                                   calls uncertain, estimated with the map: `unknowns`, each `of` a robot or a camera,
                                   with its `name` and `unit` (and of what goes evenly from one value to the next, its
                                   `course`, `at_s`), the `stated`
                                   value and its `prior` sigma, the `value` that the map is made by and its `sigma`,
                                   whether the rows `told` it, and `windows`, what stretches of the recordings say by
                                   themselves; their `covariance`; whether they are `settled` after so
                                   many `rounds`, or `why` nothing was estimated; the same in `sentences`; null where
                                   nothing is uncertain
    truth_late                     by robot, by how much the stamps of its truth are late, and were taken to be:
                                   `value_s` and `sigma_s` in the `middle` of its way [ticks], and its `drift` with
                                   `drift_sigma`, 0 where the map does not clearly tell one
    components, reasons            maps that could not be joined to each other, and why
    parts                          a table for each of these maps, in the order of their lowest robots: `robots` by
                                   name, how many `poses`, `landmarks` and `submaps`, its `frame`; of each map
                                   alone status, cost, errors and exactness by the same names as here; `objective` of
                                   its last solve; `second_places` of landmarks that fit elsewhere nearly as well
    left_out                       what went in and is in no map, each with `kind` (piece, poses, landmark, rows),
                                   `what` it is, how many `poses`, `landmarks` and `rows` are lost with it, and the
                                   `reason`
    rejected                       sightings that look wrong: the `count` of them, `of` how many, and whether they were
                                   `left_out`; the `count` is null where most of a sensor's are far off, and nobody can
                                   tell which are wrong; `sentences` alone where a glance at the residuals counts them,
                                   and where the map does not fit, or they were to be left out, also what follows:
                                   by sensor how many, the probability that one is `wrong`, and by how much the `noise`
                                   of the others is larger than stated, in variance; `open`, landmarks that a robot's
                                   sightings put in two places, and nobody decides (`larger` 1: one sighting is left,
                                   which the others contradict); each of the `rows`, with its
                                   `weight` (0 where left out), its `squared` residual in sigmas and the `gate` on it;
                                   the same in `sentences`; null where none looks wrong
    suspicions                     `labels`, names of landmarks that lie, each with its `kind` (exchanged, mistaken,
                                   apart), the `robot`, the landmarks `one` and `other`, the natural logarithm of its
                                   `odds`, and the robots that it may be `instead`; `mistaken`, robots that one takes
                                   for others; `robots`, those that contradict the others, by the chance that honest
                                   ones do (`significance`), `undecidable` where nobody can say who; those that
                                   contradict `themselves`; the same in `sentences`; and whether all of it was `mended`;
                                   null where nobody looked
    weak                           of each component what it does not know: `open`, what hangs loose; the weakest
                                   `directions`, each with its standard deviation `sigma` in a `unit` (rad of a turn, m
                                   of a shift), some `places_m` of the part that moves, and by how much one sigma
                                   moves these (`moved_m`); `place_m` and `heading_rad`, how well all else is known;
                                   each in a `sentence`; where something is open or weak, the `sightings` that would
                                   firm it up most, each with its `gain` in nats of all that is unknown, how many
                                   ways it `ties` that hang loose, and the sigmas of the directions `before` and `after`
                                   it; null where the measurements do not determine the map
    remarks                        what is in a map though something is to be known of it, in words
    ambiguities                    other ways to put the submaps together that fit nearly as well (a mirrored truss)
    robot_position_rmse_m, landmark_rmse_m, nees_per_dof      against the truth, after one alignment of the whole team;
                                   of several components, each aligned by itself
    contradicted                   `landmarks` that the truth has elsewhere than all others say, each with how far, and
                                   a `sentence`; null where there are none
    in_world                       of maps that are written in the world's frame, each: errors where nothing is aligned,
                                   how far the map is off as a whole, how well that is known, its NEES, and a
                                   `sentence`; null where there is none
    compared                       how many `poses` and `landmarks` the truth knows, and a `note` where nothing can be
                                   compared; null where there is no truth
    robots, poses, landmarks, dropped, notes                  what went in, what the reader left out, and how it
                                   understood what can be read in several ways, in words
    seen_once                      how many landmarks one row alone speaks of: nothing checks these
    refused, without               of a join of files: submaps that were refused, with the reason; those not wanted
    exactness                      of a join: how far it is from the full least squares on the same measurements (see
                                   teamslam.joining.Exactness), and in how many rounds and bytes; null for full least
                                   squares itself, and where the pieces that submaps were built of are not at hand.
                                   Of several components the worst, and the bytes of all
    exactness_unknown              why it is null; null where it is not, and for full least squares
"""

import math
import platform
from collections.abc import Sequence
from dataclasses import asdict
from importlib.metadata import version
from typing import Any

import numpy as np

from teamslam.inspection import seen_once
from teamslam.joining import Component, Cost
from teamslam.metrics import Report, told_of
from teamslam.model import Dataset, LeftOut, Names, index_of, is_landmark, robot_of
from teamslam.pipeline import Result
from teamslam.results.suspects import suspicions_of, wrong_of
from teamslam.trust import Cause, Verdict, sentence
from teamslam.trust.calibration import sentences
from teamslam.trust.unknowns import sentences_of
from teamslam.trust.weak import Direction, Weak
from teamslam.trust.weak.sightings import Sighting

UNDETERMINED = "unknown: the measurements themselves do not determine every variable where the join ended"
ALONE = "One submap, nothing to join."
PACKAGES = ("teamslam", "numpy", "scipy")
MOST_ARROWS = 24  # of a weak direction


def report_of(result: Result) -> dict[str, Any]:
    """The report of a run, ready for JSON."""
    dataset, components = result.dataset, result.joined.components
    scores = result.scores or (None,) * len(components)
    bare = result.config.method == "join" and not result.config.join.exact
    parts = [_part(*each, bare) for each in zip(components, result.costs, scores, strict=True)]
    return {
        "input": dataset.origin,
        "method": result.config.method,
        "exact": result.config.method == "join" and result.config.join.exact,
        "order": result.config.join.order,
        "converged": result.joined.converged,
        "status": _status(parts),
        "cost": _total(parts, "cost"),
        "chi2": _total(parts, "chi2"),
        "dof": _total(parts, "dof"),
        "join_cost": _total(parts, "join_cost"),
        "numbers_measured": dataset.dof,
        "numbers_used": _total(parts, "numbers_used"),
        "fit": _fit(result.verdict),
        "apart": [_cause(cause, dataset.names) for cause in result.apart],
        "calibration": _calibration(result),
        "estimated": _estimated(result),
        "truth_late": [
            {"robot": dataset.names.robot(robot), **asdict(late)} for robot, late in sorted(result.truth_late.items())
        ],
        "iterations": _total(parts, "iterations"),
        "seconds": sum(result.seconds.values()),
        "components": len(components),
        "reasons": list(result.joined.reasons),
        "left_out": [_left_out(lost) for lost in result.joined.left_out],
        "rejected": wrong_of(result),
        "suspicions": None
        if result.suspicions is None
        else suspicions_of(result.suspicions, mended=result.config.trust.repair),
        "weak": [
            None if weak is None else _weak(weak, looks)
            for weak, looks in zip(result.trust.weak, result.trust.sightings, strict=True)
        ],
        "remarks": list(result.joined.remarks),
        "ambiguities": [sentence for c in components for sentence in c.ambiguities],
        **_errors(result.scores),
        "robots": len(dataset.robots),
        "poses": sum(len(keys) for keys in dataset.pose_keys.values()),
        "landmarks": len(dataset.landmark_keys),
        "seen_once": len(seen_once(dataset)),
        "notes": list(dataset.notes),
        **_dropped(dataset),
        "exactness": (found := _exactness(parts)),
        "exactness_unknown": None if found or result.config.method == "full" else UNDETERMINED,
        "submaps": len(result.submaps),
        "parts": parts,
        "stages_s": dict(result.seconds),
        "seed": None,  # no step of a run draws random numbers that differ from run to run
        "versions": {name: version(name) for name in PACKAGES} | {"python": platform.python_version()},
    }


def _left_out(lost: LeftOut) -> dict[str, Any]:
    landmarks = int(is_landmark(lost.keys).sum())
    return {
        "kind": lost.kind,
        "what": lost.what,
        "poses": len(lost.keys) - landmarks,
        "landmarks": landmarks,
        "rows": lost.count,
        "reason": lost.reason,
    }


def _part(component: Component, cost: Cost | None, score: Report | None, bare: bool) -> dict[str, Any]:
    """One component's own report; `bare`: a join that did not go on in rounds."""
    map, solution = component.map, component.solution
    return {
        "robots": [map.names.robot(robot) for robot in map.robots_in_it],
        "poses": sum(len(map.trajectory_keys(robot)) for robot in map.robots_in_it),
        "landmarks": len(map.landmark_keys),
        "submaps": len(component.members),
        "frame": map.names.describe(map.base),
        "converged": solution is None or solution.converged,
        "status": solution.status.value if solution else ALONE,
        "cost": cost.cost if cost else None,
        "chi2": cost.chi2 if cost else None,
        "dof": map.rows - map.dof,
        "join_cost": map.cost if bare else None,
        "numbers_used": cost.rows if cost else None,
        "objective": solution.cost if solution else map.cost,
        "iterations": solution.iterations if solution else 0,
        **_errors(() if score is None else (score,)),
        "exactness": asdict(component.exactness) if component.exactness else None,
        "second_places": [
            {"landmark": map.names.landmark(int(index_of(key))), "position_m": place.tolist()}
            for key, place in component.second_places
        ],
    }


def _weak(weak: Weak, looks: Sequence[Sighting]) -> dict[str, Any]:
    """What a map does not know, what it knows least, and which sightings would firm it up."""
    return {
        "open": [{"ways": f.ways, "sentence": said} for f, said in zip(weak.open, weak.open_sentences, strict=True)],
        "directions": [
            {"sigma": d.sigma, "unit": d.unit, "sentence": d.sentence, **_arrows(weak, d)} for d in weak.directions
        ],
        "place_m": weak.least.place_m,
        "heading_rad": weak.least.heading_rad,
        "sightings": [
            {
                "robot": weak.known.names.robot(int(robot_of(look.observer))),
                "target": weak.known.names.describe(look.target),
                "distance_m": look.distance,
                "gain": look.gain,
                "ties": look.ties,
                "before": look.before.tolist(),
                "after": look.after.tolist(),
                "sentence": look.sentence,
            }
            for look in looks
        ],
        "sentence": weak.rest,
    }


def _arrows(weak: Weak, direction: Direction) -> dict[str, Any]:
    """Some places of the part that a weak direction moves, and by how much one sigma of it does."""
    part = np.flatnonzero(direction.part)
    places = weak.known.motions.places[part[:: -(-len(part) // MOST_ARROWS)]]
    return {"places_m": places.tolist(), "moved_m": direction.moved(places).tolist()}


def _fit(found: Verdict) -> dict[str, Any]:
    """The verdict on the fit, in words and figures."""
    names = found.names
    return {
        "verdict": found.level,
        "gross": found.gross,
        "sentence": sentence(found),
        "cost": found.cost,
        "expected": found.expected,
        "band": list(found.band),
        "chi2": found.chi2,
        "dof": found.dof,
        "decrease": found.decrease,
        "causes": [_cause(cause, names) for cause in found.causes],
        "carriers": [{**asdict(share), "ratio": share.ratio} for share in found.carriers],
        "sensors": [{**asdict(share), "ratio": share.ratio} for share in found.sensors],
        "noise": [{**asdict(noise), "robot": names.robot(noise.robot)} for noise in found.noise],
    }


def _cause(cause: Cause, names: Names) -> dict[str, Any]:
    told = {field: getattr(cause, field) for field in ("kind", "sentence", "explains")}
    return {**told, "robots": [names.robot(robot) for robot in cause.robots]}


def _calibration(result: Result) -> dict[str, Any] | None:
    """What was wrong with the model of the data, in words and figures."""
    found = result.calibration
    if found is None:
        return None
    names = found.names
    known = ("source", "model", "term", "unit", "value", "sigma", "prior")
    return {
        "sentences": sentences(found),
        "systematic": [
            {
                "robot": names.robot(e.robot),
                **{k: getattr(e, k) for k in known},
                **({"landmark": names.landmark(e.landmark)} if e.landmark else {}),
            }
            for e in found.systematic
        ],
        "scales": [{**asdict(scale), "robot": names.robot(scale.robot)} for scale in found.scales],
        "slips": [asdict(slip) for slip in found.slips],
        "lasting": [asdict(lasting) for lasting in found.lasting],
        "sigmas_m": [asdict(sigmas) for sigmas in found.sigmas],
    }


def _estimated(result: Result) -> dict[str, Any] | None:
    """What was found of clocks, cameras and edges of tags, in words and figures."""
    found = result.unknowns
    if found is None:
        return None
    return {
        "sentences": sentences_of(found),
        "settled": found.settled,
        "rounds": found.rounds,
        "why": found.why or None,
        "unknowns": [
            {**asdict(one.unknown), "value": one.value, "sigma": one.sigma, "told": one.told,
             "windows": [asdict(window) for window in one.windows]}
            for one in found.found
        ],
        "covariance": found.covariance.tolist(),
    }  # fmt: skip


def _status(parts: Sequence[dict[str, Any]]) -> str:
    """How all parts ended, in one sentence where they ended alike."""
    found = [part["status"] for part in parts]
    if len(set(found)) == 1:
        return str(found[0]) if len(found) == 1 or found[0] != ALONE else "One submap each, nothing to join."
    return " ".join(f"Part {number}: {sentence}" for number, sentence in enumerate(found, start=1))


def _total(parts: Sequence[dict[str, Any]], name: str) -> Any:
    """A number of all parts together; None where that of one is unknown."""
    found = [part[name] for part in parts]
    return None if any(value is None for value in found) else sum(found)


def _errors(scores: Sequence[Report]) -> dict[str, Any]:
    """Errors against the truth, of several components together, each aligned by itself."""
    scored = [s.accuracy for s in scores if s.accuracy]
    nees = [s.consistency.nees for s in scores if s.consistency]
    dof = sum(found.dof for found in nees)
    notes = dict.fromkeys(s.note for s in scores if s.note)
    compared = {"poses": sum(a.poses for a in scored), "landmarks": sum(a.landmarks for a in scored)}
    odd = [found for s in scores for found in s.contradicted]
    return {
        "contradicted": {"landmarks": [asdict(found) for found in odd], "sentence": told_of(odd)} if odd else None,
        "in_world": [s.to_dict()["in_world"] for s in scores if s.in_world] or None,
        "robot_position_rmse_m": _pooled([(a.poses, a.robot_position_rmse_m) for a in scored]),
        "landmark_rmse_m": _pooled([(a.landmarks, a.landmark_rmse_m) for a in scored]),
        "nees_per_dof": sum(found.value for found in nees) / dof if dof > 0 else None,
        "compared": {**compared, "note": "; ".join(notes)} if scores else None,
    }


def _pooled(roots: Sequence[tuple[int, float | None]]) -> float | None:
    """The root of the mean square over several groups, from how many each has and its own."""
    known = [(count, root) for count, root in roots if root is not None]
    total = sum(count for count, _ in known)
    return math.sqrt(sum(count * root**2 for count, root in known) / total) if total else None


def _dropped(dataset: Dataset) -> dict[str, Any]:
    return {
        "dropped": sum(d.count for d in dataset.dropped),
        "dropped_reasons": [{"count": d.count, "reason": d.reason} for d in dataset.dropped],
    }


def _exactness(parts: Sequence[dict[str, Any]]) -> dict[str, float] | None:
    known = [part["exactness"] for part in parts]
    if any(found is None for found in known):
        return None
    return {name: (sum if name == "bytes" else max)(each[name] for each in known) for name in known[0]}
