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
    """Return the row of a track as it stands in ``result.json``, of a record of a duration [s]."""
    every = {**track["parameters"], **track.get("derived", {})}
    values = {key: table_value(key, found, track["verdict"]) for key, found in every.items()}
    numbers = {key: value.value for key, value in values.items()}
    conditions = track.get("conditions", ())
    return ResultRow(
        record,
        name,
        values,
        {one["fact"]: one["message"] for one in conditions},
        {one["fact"]: one["remedy"] for one in conditions},
        tuple(ResultFinding.of_flag(flag, numbers) for flag in map(Flag.of_table, track["flags"])),
        measures=_measures(track, duration),
    )


def _measures(track: Mapping[str, Any], duration: float) -> TrackMeasures | None:
    if "comparison" not in track:
        return None
    nis = math.nan if track["nis"] is None else track["nis"]
    comparison = TrackComparison.of_table(track["comparison"])
    return TrackMeasures.of(comparison, nis, track["seconds_per_sample"], track["samples"], duration)


def table_value(name: str, found: Mapping[str, Any], of_track: str) -> TableValue:
    """Return a value of ``result.json``; one without a verdict of its own has that of its track."""
    if of_track == "invalid":
        return TableValue(name, None, math.nan, found["unit"], "invalid")
    combined = found.get("combined")
    return TableValue(
        name,
        estimate_of(found),
        math.nan if combined is None else combined,
        found["unit"],
        found.get("verdict") or of_track,
        found.get("places") or {},
    )
