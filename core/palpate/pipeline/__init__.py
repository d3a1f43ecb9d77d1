"""The pipeline at work: devices -> alignment -> tracks -> sinks -> result."""

from palpate.pipeline.examine import Finding, examine
from palpate.pipeline.running import Result, run_pipeline
from palpate.pipeline.tracks import start_tracks

__all__ = ["Finding", "Result", "examine", "run_pipeline", "start_tracks"]
