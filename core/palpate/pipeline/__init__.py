"""The pipeline at work: devices -> alignment -> tracks -> sinks -> result."""

from palpate.pipeline.concluding import Result
from palpate.pipeline.device_flags import payloads
from palpate.pipeline.flow import Flow, each, the_trajectory
from palpate.pipeline.guard import Guard
from palpate.pipeline.interrupt import interruptible
from palpate.pipeline.live import LiveLinks
from palpate.pipeline.running import run_pipeline
from palpate.pipeline.standstill import declared_noise
from palpate.pipeline.start import check_way
from palpate.pipeline.tracks import start_tracks

__all__ = [
    "Flow",
    "Guard",
    "LiveLinks",
    "Result",
    "check_way",
    "declared_noise",
    "each",
    "interruptible",
    "payloads",
    "run_pipeline",
    "start_tracks",
    "the_trajectory",
]
