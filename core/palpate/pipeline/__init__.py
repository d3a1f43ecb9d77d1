"""The pipeline at work: devices -> alignment -> tracks -> sinks -> result."""

from palpate.pipeline.arrivals import each
from palpate.pipeline.device_flags import payloads
from palpate.pipeline.flow import Flow
from palpate.pipeline.interrupt import interruptible
from palpate.pipeline.live.approach import check_approach
from palpate.pipeline.live.guard import Guard
from palpate.pipeline.live.links import LiveLinks
from palpate.pipeline.live.standstill import declared_noise
from palpate.pipeline.pipeline_run import run_pipeline
from palpate.pipeline.planned_motion import single_trajectory
from palpate.pipeline.record_tracks import RecordOutcome, RecordTracks
from palpate.pipeline.rehearsal import refuse_rehearsal
from palpate.pipeline.run_result import Result
from palpate.pipeline.tracks import start_tracks

__all__ = [
    "Flow",
    "Guard",
    "LiveLinks",
    "RecordOutcome",
    "RecordTracks",
    "Result",
    "check_approach",
    "declared_noise",
    "each",
    "interruptible",
    "payloads",
    "refuse_rehearsal",
    "run_pipeline",
    "single_trajectory",
    "start_tracks",
]
