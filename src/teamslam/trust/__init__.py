"""Whether results are to be believed: what maps and logs show of it, as data."""

from teamslam.trust.assessment import Assessment, assess, suspected_beside
from teamslam.trust.carriers import Share
from teamslam.trust.cause import Cause
from teamslam.trust.fit import (
    Verdict,
    explained,
    mistakes,
    unknown,
    verdict,
    verdict_where_costly,
    with_plain_reasons,
)
from teamslam.trust.noise import Noise
from teamslam.trust.outliers.decide import Decisions, wrong_sightings
from teamslam.trust.outliers.words import sentences_on_sightings
from teamslam.trust.residuals import Residuals, Rows
from teamslam.trust.suspicions import Suspicions, mended, suspicions
from teamslam.trust.undoubted import named_beyond_doubt
from teamslam.trust.words import sentence

__all__ = [
    "Assessment",
    "Cause",
    "Decisions",
    "Noise",
    "Residuals",
    "Rows",
    "Share",
    "Suspicions",
    "Verdict",
    "assess",
    "explained",
    "mended",
    "mistakes",
    "named_beyond_doubt",
    "sentence",
    "sentences_on_sightings",
    "suspected_beside",
    "suspicions",
    "unknown",
    "verdict",
    "verdict_where_costly",
    "with_plain_reasons",
    "wrong_sightings",
]
