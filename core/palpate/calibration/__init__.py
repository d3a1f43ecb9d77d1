"""Calibration: mass, timing, tare and noise of a rig from its motion in free air, each with its uncertainty."""

from palpate.calibration.applying import CalibrationUse, identity_in, identity_of
from palpate.calibration.file import CalibratedValue, Calibration, NoiseSpectrum, read_calibration
from palpate.calibration.orientations import Pose, WrenchRecorder, weighed
from palpate.calibration.protocol import Session, calibrate, joined
from palpate.calibration.quantity import Measured, Scatter
from palpate.calibration.record import Record, Recorder, Track
from palpate.calibration.rest import Rest, RestFit, Spectrum, rest_fit
from palpate.calibration.segments import Segment, resting, shaking
from palpate.calibration.settings import ON_A_PLATE, STEPS, CalibrationSettings, Orientations, Step, TypeB
from palpate.calibration.shake import ShakeFit, shake_fit
from palpate.calibration.statics import WeightFit, series_compliance, tap_delay, weight_fit
from palpate.calibration.steps import evaluated

__all__ = [
    "ON_A_PLATE",
    "STEPS",
    "CalibratedValue",
    "Calibration",
    "CalibrationSettings",
    "CalibrationUse",
    "Measured",
    "NoiseSpectrum",
    "Orientations",
    "Pose",
    "Record",
    "Recorder",
    "Rest",
    "RestFit",
    "Scatter",
    "Segment",
    "Session",
    "ShakeFit",
    "Spectrum",
    "Step",
    "Track",
    "TypeB",
    "WeightFit",
    "WrenchRecorder",
    "calibrate",
    "evaluated",
    "identity_in",
    "identity_of",
    "joined",
    "read_calibration",
    "rest_fit",
    "resting",
    "series_compliance",
    "shake_fit",
    "shaking",
    "tap_delay",
    "weighed",
    "weight_fit",
]
