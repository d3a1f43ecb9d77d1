"""The pipeline at work: devices -> alignment -> tracks -> sinks -> result."""

from palpate.pipeline.calibrating import Guide, run_calibration
from palpate.pipeline.continuation import continued, next_part, parts_of, recorded_pipeline, remaining_pipeline
from palpate.pipeline.examine import Finding, examine
from palpate.pipeline.running import Result, run_pipeline
from palpate.pipeline.tracks import start_tracks

__all__ = [
    "Finding",
    "Guide",
    "Result",
    "continued",
    "examine",
    "next_part",
    "parts_of",
    "recorded_pipeline",
    "remaining_pipeline",
    "run_calibration",
    "run_pipeline",
    "start_tracks",
]
