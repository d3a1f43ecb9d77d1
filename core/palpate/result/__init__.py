"""Results: what a run found, what may be wrong with it, and where it is written."""

from palpate.result.diagnosing import Diagnosable, Judged, diagnosed
from palpate.result.flags import track_flags
from palpate.result.folder import EstimatesFile, make_folder, withdraw_folder
from palpate.result.found import Derived, Found, finite, finite_tree
from palpate.result.outcome import TrackResult, record_flags, stream_tables, track_result
from palpate.result.reading import SCHEMA, is_whole, read_flags, read_result, upgraded
from palpate.result.record import TrackRecord, acceleration
from palpate.result.run_folder import (
    GIVEN,
    ONLINE,
    PIPELINE,
    RESULT,
    EstimatesTable,
    RunFolder,
    TrackTable,
    pipeline_among,
)

__all__ = [
    "GIVEN",
    "ONLINE",
    "PIPELINE",
    "RESULT",
    "SCHEMA",
    "Derived",
    "Diagnosable",
    "EstimatesFile",
    "EstimatesTable",
    "Found",
    "Judged",
    "RunFolder",
    "TrackRecord",
    "TrackResult",
    "TrackTable",
    "acceleration",
    "diagnosed",
    "finite",
    "finite_tree",
    "is_whole",
    "make_folder",
    "pipeline_among",
    "read_flags",
    "read_result",
    "record_flags",
    "stream_tables",
    "track_flags",
    "track_result",
    "upgraded",
    "withdraw_folder",
]
