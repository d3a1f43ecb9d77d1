"""Results: what a run found, what may be wrong with it, and where it is written."""

from palpate.result.flags import flag
from palpate.result.folder import EstimatesFile, make_folder, write_new
from palpate.result.outcome import (
    Found,
    TrackResult,
    finite,
    finite_tree,
    record_flags,
    stream_tables,
    track_result,
)
from palpate.result.record import TrackRecord, acceleration
from palpate.result.timing import timing_uncertainty

__all__ = [
    "EstimatesFile",
    "Found",
    "TrackRecord",
    "TrackResult",
    "acceleration",
    "finite",
    "finite_tree",
    "flag",
    "make_folder",
    "record_flags",
    "stream_tables",
    "timing_uncertainty",
    "track_result",
    "write_new",
]
