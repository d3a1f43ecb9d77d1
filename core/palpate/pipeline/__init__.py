"""The pipeline at work: devices -> alignment -> tracks -> sinks -> result."""

from palpate.pipeline.continuation import continued, recorded_pipeline, remaining_pipeline
from palpate.pipeline.examine import Finding, examine
from palpate.pipeline.flow import Flow, each, the_trajectory
from palpate.pipeline.interrupt import interruptible
from palpate.pipeline.running import Result, run_pipeline
from palpate.pipeline.tracks import start_tracks

__all__ = [
    "Finding",
    "Flow",
    "Result",
    "continued",
    "each",
    "examine",
    "interruptible",
    "recorded_pipeline",
    "remaining_pipeline",
    "run_pipeline",
    "start_tracks",
    "the_trajectory",
]
