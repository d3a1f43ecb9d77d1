"""The pipeline at work: devices -> alignment -> tracks -> sinks -> result."""

from palpate_engine.pipeline.approach import check_approach
from palpate_engine.pipeline.arrivals import each
from palpate_engine.pipeline.device_flags import payloads
from palpate_engine.pipeline.flow import Flow
from palpate_engine.pipeline.interrupt import interruptible
from palpate_engine.pipeline.pipeline_run import run_pipeline
from palpate_engine.pipeline.planned_motion import single_trajectory
from palpate_engine.pipeline.record_tracks import RecordOutcome, RecordTracks
from palpate_engine.pipeline.rehearsal import refuse_rehearsal
from palpate_engine.pipeline.run_flow import run_flow
from palpate_engine.pipeline.run_result import Result
from palpate_engine.pipeline.tracks import declared_noise, start_tracks

__all__ = [
    "Flow",
    "RecordOutcome",
    "RecordTracks",
    "Result",
    "check_approach",
    "declared_noise",
    "each",
    "interruptible",
    "payloads",
    "refuse_rehearsal",
    "run_flow",
    "run_pipeline",
    "single_trajectory",
    "start_tracks",
]
