"""Whether results are to be believed: what maps and logs show of it, as data."""

from teamslam.trust.carriers import Share
from teamslam.trust.cause import Cause
from teamslam.trust.fit import Verdict, explained, unknown, verdict, with_plain_reasons
from teamslam.trust.noise import Noise
from teamslam.trust.residuals import Residuals, Rows
from teamslam.trust.words import sentence

__all__ = [
    "Cause",
    "Noise",
    "Residuals",
    "Rows",
    "Share",
    "Verdict",
    "explained",
    "sentence",
    "unknown",
    "verdict",
    "with_plain_reasons",
]
