"""Results: what a run found, what may be wrong with it, and where it is written."""

from palpate.result.agreement import contradictions
from palpate.result.condition import Condition
from palpate.result.diagnoses import Diagnosable, RunEvidence, apply_diagnoses
from palpate.result.record_flags import track_flags
from palpate.result.record_outcome import record_flags, stream_tables, track_result
from palpate.result.result_folder import (
    GIVEN,
    PIPELINE,
    RESULT,
    SCHEMA,
    make_folder,
    withdraw_folder,
)
from palpate.result.track_record import TrackRecord
from palpate.result.track_result import TrackResult
from palpate.result.track_tail import acceleration
from palpate.result.uncertain_value import DerivedValue, UncertainValue, finite, finite_tree

__all__ = [
    "GIVEN",
    "PIPELINE",
    "RESULT",
    "SCHEMA",
    "Condition",
    "DerivedValue",
    "Diagnosable",
    "RunEvidence",
    "TrackRecord",
    "TrackResult",
    "UncertainValue",
    "acceleration",
    "apply_diagnoses",
    "contradictions",
    "finite",
    "finite_tree",
    "make_folder",
    "record_flags",
    "stream_tables",
    "track_flags",
    "track_result",
    "withdraw_folder",
]
