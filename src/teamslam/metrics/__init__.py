"""How good a map is: errors after one alignment of the team, honesty of its covariances, the bound on both."""

from teamslam.metrics.accuracy import Accuracy, PairErrors, PerNumber, RobotErrors, Track, errors_at_base
from teamslam.metrics.bound import Bound, cramer_rao
from teamslam.metrics.consistency import ChiSquare, Consistency, MarginalNees, Marginals, fit_of
from teamslam.metrics.contradicted import Contradiction, told_of
from teamslam.metrics.frames import Aligned, align_team, truth_at_base
from teamslam.metrics.naming import as_called
from teamslam.metrics.report import Report, errors_of, score
from teamslam.metrics.retimed import Late, late_truth
from teamslam.metrics.sampling import at_stamps_of
from teamslam.metrics.truth_clocks import truth_clocks

__all__ = [
    "Accuracy",
    "Aligned",
    "Bound",
    "ChiSquare",
    "Consistency",
    "Contradiction",
    "Late",
    "MarginalNees",
    "Marginals",
    "PairErrors",
    "PerNumber",
    "Report",
    "RobotErrors",
    "Track",
    "align_team",
    "as_called",
    "at_stamps_of",
    "cramer_rao",
    "errors_at_base",
    "errors_of",
    "fit_of",
    "late_truth",
    "score",
    "told_of",
    "truth_at_base",
    "truth_clocks",
]
