"""Calibrated information: what is wrong with the model of the data, found in the data and put right."""

from teamslam.trust.calibration.alone import honest
from teamslam.trust.calibration.calibrate import Calibration, Lasting, Scale, Slip, as_stated, calibrate
from teamslam.trust.calibration.carried import rows_inside
from teamslam.trust.calibration.systematic import Systematic
from teamslam.trust.calibration.words import sentences

__all__ = [
    "Calibration", "Lasting", "Scale", "Slip", "Systematic",
    "as_stated", "calibrate", "honest", "rows_inside", "sentences",
]  # fmt: skip
