"""Results that were read as the table of results."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from palpate import Flag
from palpate_engine import TrackComparison

from palpate_kit.runs.result_file import estimate_of
from palpate_kit.terminal.result_table import ResultFinding, ResultRow, ResultTable, TableValue, TrackMeasures


def document_table(document: Mapping[str, Any]) -> ResultTable:
    """Return the table of the tracks of a ``result.json``."""
    duration = document.get("run", {}).get("log_duration") or 0.0
    rows = tuple(document_row(name, track, duration=duration) for name, track in document.get("tracks", {}).items())
    return ResultTable(rows, document.get("truth", {}))


def document_row(name: str, track: Mapping[str, Any], record: str = "", duration: float = 0.0) -> ResultRow:
    """Return the row of the table of results of a track, as it stands in ``result.json``; `duration` of its record
    [s]."""
    estimates = {**track["parameters"], **track.get("derived", {})}
    values = {key: table_value(key, estimate, track["verdict"]) for key, estimate in estimates.items()}
    numbers = {key: value.value for key, value in values.items()}
    conditions = track.get("conditions", ())
    return ResultRow(
        record,
        track=name,
        values=values,
        conditions={condition["fact"]: condition["message"] for condition in conditions},
        remedies={condition["fact"]: condition["remedy"] for condition in conditions},
        findings=tuple(ResultFinding.of_flag(flag, numbers) for flag in map(Flag.of_table, track["flags"])),
        measures=_measures(track, duration),
    )


def _measures(track: Mapping[str, Any], duration: float) -> TrackMeasures | None:
    """Return the measures of a track in a record of a duration [s]; None for one that is not compared."""
    if "comparison" not in track:
        return None
    nis = math.nan if track["nis"] is None else track["nis"]
    comparison = TrackComparison.of_table(track["comparison"])
    return TrackMeasures.of(comparison, nis, track["seconds_per_sample"], track["samples"], duration)


def table_value(name: str, estimate: Mapping[str, Any], track_verdict: str) -> TableValue:
    """Return a value of ``result.json``; one without a verdict of its own has that of its track."""
    if track_verdict == "invalid":
        return TableValue(name, None, math.nan, estimate["unit"], "invalid")
    combined = estimate.get("combined")
    return TableValue(
        name,
        value=estimate_of(estimate),
        combined=math.nan if combined is None else combined,
        unit=estimate["unit"],
        verdict=estimate.get("verdict") or track_verdict,
        places=estimate.get("places") or {},
    )
