"""The pipeline at work: devices -> alignment -> tracks -> sinks -> result."""

from palpate.pipeline.calibrating import run_calibration
from palpate.pipeline.running import Result, run_pipeline
from palpate.pipeline.tracks import start_tracks

__all__ = ["Result", "run_calibration", "run_pipeline", "start_tracks"]
