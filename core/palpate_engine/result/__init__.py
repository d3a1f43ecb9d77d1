"""Results: what a run found, what may be wrong with it, and where it is written."""

from palpate.evidence.condition import Condition
from palpate.evidence.track_tail import acceleration
from palpate.evidence.uncertain_value import DerivedValue, UncertainValue, finite, finite_tree

from palpate_engine.result.agreement import contradictions
from palpate_engine.result.diagnoses import Diagnosable, RunEvidence, apply_diagnoses
from palpate_engine.result.record_flags import track_flags
from palpate_engine.result.record_outcome import record_flags, stream_tables, track_result
from palpate_engine.result.result_folder import (
    GIVEN,
    PIPELINE,
    RESULT,
    SCHEMA,
    make_folder,
    withdraw_folder,
)
from palpate_engine.result.track_comparison import ComparisonRecord, TrackComparison
from palpate_engine.result.track_record import TrackRecord
from palpate_engine.result.track_result import TrackResult

__all__ = [
    "GIVEN",
    "PIPELINE",
    "RESULT",
    "SCHEMA",
    "ComparisonRecord",
    "Condition",
    "DerivedValue",
    "Diagnosable",
    "RunEvidence",
    "TrackComparison",
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
