"""Calibrations: the file of a rig's calibration, and what a pipeline takes from it."""

from palpate.calibration.applying import CalibrationUse, identity_in, identity_of
from palpate.calibration.file import CalibratedValue, Calibration, NoiseSpectrum, read_calibration

__all__ = [
    "CalibratedValue",
    "Calibration",
    "CalibrationUse",
    "NoiseSpectrum",
    "identity_in",
    "identity_of",
    "read_calibration",
]
