"""report.json: what a script wants to know of a run, one flat table; null where no truth exists.

Its fields:

    method, exact                  join or full; whether a join went on in rounds
    converged, status              how it ended; `status` is a sentence
    cost, chi2, dof                sum of losses; sum of squared whitened residuals (no factor 1/2, outliers in full);
                                   rows - unknowns
    objective                      of the last solve: of a join, what eq. (11) adds to the cost of the submaps
    iterations, seconds            of the last solve; of the whole run
    components, reasons            maps that could not be joined to each other, and why
    ambiguities                    other ways to put the submaps together that fit nearly as well (a mirrored truss)
    robot_position_rmse_m, landmark_rmse_m, nees_per_dof      against the truth, after one alignment of the whole team
    robots, poses, landmarks, dropped                         what went in
    refused, left_out              of a join of files: submaps that were refused, with the reason; those not wanted
    exactness                      of a join: how far it is from the full least squares on the same measurements (see
                                   teamslam.joining.Exactness), and in how many rounds and bytes; null for full least
                                   squares itself, and where the pieces that submaps were built of are not at hand.
                                   Of several components the worst, and the bytes of all
"""

import platform
from dataclasses import asdict
from importlib.metadata import version
from typing import Any

from teamslam.joining import Joined
from teamslam.pipeline import Result

ALONE = "One submap, nothing to join."
PACKAGES = ("teamslam", "numpy", "scipy")


def report_of(result: Result) -> dict[str, Any]:
    """The report of a run, ready for JSON."""
    joined, dataset, score = result.joined, result.dataset, result.report
    maps = [c.map for c in joined.components]
    solution = joined.components[0].solution
    return {
        "input": dataset.origin,
        "method": result.config.method,
        "exact": result.config.method == "join" and result.config.join.exact,
        "converged": joined.converged,
        "status": solution.status.value if solution else ALONE,
        "cost": sum(m.cost for m in maps),
        "chi2": sum(m.chi2 for m in maps),
        "objective": solution.cost if solution else maps[0].cost,
        "dof": sum(m.rows - m.dof for m in maps),
        "iterations": solution.iterations if solution else 0,
        "seconds": sum(result.seconds.values()),
        "components": len(joined.components),
        "reasons": list(joined.reasons),
        "ambiguities": [sentence for c in joined.components for sentence in c.ambiguities],
        "robot_position_rmse_m": score.robot_position_rmse_m if score else None,
        "landmark_rmse_m": score.landmark_rmse_m if score else None,
        "nees_per_dof": score.nees_per_dof if score else None,
        "robots": len(dataset.robots),
        "poses": sum(len(keys) for keys in dataset.pose_keys.values()),
        "landmarks": len(dataset.landmark_keys),
        "dropped": sum(d.count for d in dataset.dropped),
        "dropped_reasons": [{"count": d.count, "reason": d.reason} for d in dataset.dropped],
        "exactness": _exactness(joined),
        "submaps": len(result.submaps),
        "stages_s": dict(result.seconds),
        "seed": None,  # no step of a run draws random numbers
        "versions": {name: version(name) for name in PACKAGES} | {"python": platform.python_version()},
    }


def _exactness(joined: Joined) -> dict[str, float] | None:
    known = [asdict(c.exactness) for c in joined.components if c.exactness is not None]
    if len(known) < len(joined.components):
        return None
    return {name: (sum if name == "bytes" else max)(each[name] for each in known) for name in known[0]}
