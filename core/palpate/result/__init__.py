"""Results: what a run found, what may be wrong with it, and where it is written."""

from palpate.result.diagnosing import Diagnosable, Judged, diagnosed
from palpate.result.flags import track_flags
from palpate.result.folder import (
    GIVEN,
    PIPELINE,
    RESULT,
    SCHEMA,
    make_folder,
    withdraw_folder,
)
from palpate.result.found import Derived, Found, finite, finite_tree
from palpate.result.outcome import record_flags, stream_tables, track_result
from palpate.result.record import TrackRecord
from palpate.result.tail import acceleration
from palpate.result.track_result import TrackResult

__all__ = [
    "GIVEN",
    "PIPELINE",
    "RESULT",
    "SCHEMA",
    "Derived",
    "Diagnosable",
    "Found",
    "Judged",
    "TrackRecord",
    "TrackResult",
    "acceleration",
    "diagnosed",
    "finite",
    "finite_tree",
    "make_folder",
    "record_flags",
    "stream_tables",
    "track_flags",
    "track_result",
    "withdraw_folder",
]
