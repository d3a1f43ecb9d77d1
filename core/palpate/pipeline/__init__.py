"""The pipeline at work: devices -> alignment -> tracks -> sinks -> result."""

from palpate.pipeline.calibrating import run_calibration
from palpate.pipeline.continuation import continued, next_part, parts_of, recorded_pipeline, remaining_pipeline
from palpate.pipeline.running import Result, run_pipeline
from palpate.pipeline.tracks import start_tracks

__all__ = [
    "Result",
    "continued",
    "next_part",
    "parts_of",
    "recorded_pipeline",
    "remaining_pipeline",
    "run_calibration",
    "run_pipeline",
    "start_tracks",
]
