"""Calibration: mass, timing, tare and noise of a rig from its motion in free air, each with its uncertainty."""

from palpate.calibration.applying import CalibrationUse, identity_of
from palpate.calibration.file import CalibratedValue, Calibration, read_calibration
from palpate.calibration.protocol import Session, calibrate
from palpate.calibration.quantity import Measured, Scatter
from palpate.calibration.record import Record, Recorder, Track
from palpate.calibration.rest import Rest, RestFit, rest_fit
from palpate.calibration.segments import Segment, resting, shaking
from palpate.calibration.settings import CalibrationSettings, TypeB
from palpate.calibration.shake import ShakeFit, shake_fit
from palpate.calibration.statics import WeightFit, series_compliance, tap_delay, weight_fit

__all__ = [
    "CalibratedValue",
    "Calibration",
    "CalibrationSettings",
    "CalibrationUse",
    "Measured",
    "Record",
    "Recorder",
    "Rest",
    "RestFit",
    "Scatter",
    "Segment",
    "Session",
    "ShakeFit",
    "Track",
    "TypeB",
    "WeightFit",
    "calibrate",
    "identity_of",
    "read_calibration",
    "rest_fit",
    "resting",
    "series_compliance",
    "shake_fit",
    "shaking",
    "tap_delay",
    "weight_fit",
]
