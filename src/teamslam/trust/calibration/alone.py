"""One submap calibrated by what its own robot has measured, so that what is sent is honest before anybody is asked.

A robot alone knows less than a team: how its ranges' scale differs from those of others is not seen (see `terms`), nor
is what only their disagreement shows. What is common to all its sightings stays in its claim until a team's log is
mapped as one.
"""

from teamslam.joining import AtMap, build_with_solution
from teamslam.model import Dataset, Submap
from teamslam.solver import Options
from teamslam.solver.optimise import DEFAULTS
from teamslam.trust.calibration.calibrate import Calibration, calibrate
from teamslam.trust.calibration.carried import rows_inside


def honest(submap: Submap, piece: Dataset, *, options: Options = DEFAULTS) -> tuple[Submap, Calibration]:
    """The submap of a piece with its noise put right, and what was; itself where nothing is wrong, or errors are so
    large that they are no noise, or it holds one pose alone. Systematic errors travel among its variables (see
    `carried`)."""
    if not submap.dof:
        return submap, Calibration()
    found = calibrate([AtMap(piece.tables, submap)])
    if not found or found.wild:
        return submap, Calibration()
    right = found.put_right(piece)
    again, _ = build_with_solution(right, version=submap.version, options=options, near=found.start_of(submap))
    return found.carried_by(again, rows_inside(again, right)), found
