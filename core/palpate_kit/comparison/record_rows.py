"""Measures of all tracks of one record, as rows of plain data: nothing is written, and nothing is diagnosed.

Uncertainties are those of the estimators, with what their values have still to move: of simulated records all else is
known.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol, runtime_checkable

import numpy as np
from palpate import ContactModel, Estimates, Floats, PalpateError, Samples, Status, UserError
from palpate_engine import (
    Pipeline,
    RecordOutcome,
    RecordTracks,
    TrackComparison,
    TrackResult,
    finite_tree,
    start_tracks,
)

from palpate_kit.terminal.result_table import chief_names

Row = dict[str, Any]
VALUES, PREDICTION = "values", "prediction"  # of a scene: what its tracks are compared by
_SWEEP = 2e-3  # [m] between places, from which on a truth is that of each place, as that of a run: a choice


@runtime_checkable
class KnowsTruthByPlace(Protocol):
    """A simulated device that knows the values that an estimator should find at each place of the skin."""

    def truth_at(self, places: Floats) -> Mapping[str, Floats]:
        """Return the values (n,) [SI] at places (n, 2) [m] by parameter name."""
        ...


def record_rows(pipeline: Pipeline, record: int, measure: str = VALUES) -> list[Row]:
    """Return a row for each track of a pipeline on its record; the row of a track that cannot start has the reason.

    `record` is the number of the record, `measure` the kind of columns: VALUES has the errors of the values as well.
    Raises PalpateError where the record cannot be read.
    """
    # Diagnoses and summaries are not compared.
    bare = replace(pipeline, registry=replace(pipeline.registry, diagnoses={}, summaries={}))
    scene: Row = {"scene": pipeline.run.name, "record": record}
    refused = dict[str, str]()
    outcome: RecordOutcome | None = None
    try:
        outcome = RecordTracks(bare, compares=True).estimate()
    except UserError:
        refused = dict(_refusals(bare))
        # Tracks that cannot start have a row with the reason; the others are estimated.
        startable = tuple(track for track in bare.tracks if str(track.name) not in refused)
        if not refused:
            raise
        if startable:
            outcome = RecordTracks(replace(bare, tracks=startable), compares=True).estimate()
    results = {} if outcome is None else outcome.result.tracks
    rows = [{**scene, "track": str(name), "flag": "failed", "reason": reason} for name, reason in refused.items()]
    for name, track in results.items():
        assert outcome is not None
        rows.append({**scene, "track": str(name), **_measures(outcome, pipeline, str(name), track, measure)})
    return rows


def _refusals(pipeline: Pipeline) -> Iterator[tuple[str, str]]:
    """Return the tracks that cannot start, each with its reason."""
    for track in pipeline.tracks:
        try:
            start_tracks(replace(pipeline, tracks=(track,)))
        except PalpateError as error:
            yield str(track.name), str(error)


def _measures(outcome: RecordOutcome, pipeline: Pipeline, name: str, track: TrackResult, measure: str) -> Row:
    """Return values with errors, prediction, NIS, time to settle and cost of one track.

    `outcome` has the samples, estimates and results of all tracks of a record; `measure` is VALUES for errors of the
    values, too.
    """
    comparison = track.comparison
    assert comparison is not None
    model = next(candidate.model for candidate in pipeline.tracks if str(candidate.name) == name)
    row: Row = {}
    for value_name, error in _errors(outcome, pipeline, name, track, model).items() if measure == VALUES else ():
        row |= {f"{value_name}_{key}": finite_tree(number) for key, number in error.items()}
    duration = outcome.result.run.get("log_duration") or 0.0
    first = next(iter(comparison.settling_times.values()), math.nan)  # [s] of the first parameter
    return row | {
        "prediction": finite_tree(comparison.prediction),
        "nis": finite_tree(track.nis),
        "nis_low": finite_tree(comparison.nis_band[0]),
        "nis_high": finite_tree(comparison.nis_band[1]),
        "settled": finite_tree(first),
        "seconds_per_sample": track.seconds_per_sample,
        "samples": track.samples,
        "is_slow": track.seconds_per_sample * track.samples > duration > 0,
        "flag": next((flag.code for flag in track.flags if flag.severity == "invalid"), ""),
        "reason": next((flag.message for flag in track.flags if flag.severity == "invalid"), ""),
    }


def _errors(
    outcome: RecordOutcome, pipeline: Pipeline, name: str, track: TrackResult, model: ContactModel
) -> dict[str, dict[str, float]]:
    """Return value, combined uncertainty u, truth, relative error, and error in u, of each value by name.

    Along a sweep the errors are rms over its samples.
    """
    values = {**track.parameters, **{derived.name: derived.found for derived in track.derived}}
    names, truth, usable = chief_names(values), outcome.result.truth, track.usable
    along = truth_along(pipeline, outcome.samples)  # by name, (n,) of the samples; None without a sweep
    errors = dict[str, dict[str, float]]()
    for place, value_name in enumerate(values):
        if value_name not in names:
            continue
        value = values[value_name]
        errors[value_name] = {"value": value.value, "u": value.combined} if usable else {}
        if not usable or value_name not in truth:
            continue
        if along is None:
            errors[value_name] |= _error_of(np.array([value.value]), np.array([value.combined]), truth[value_name])
        # Along a sweep each sample has a truth of its own; derived values have no estimates by sample.
        elif place < len(model.parameters):
            estimates = outcome.estimates[name]
            errors[value_name] |= _error_along(outcome.samples, estimates, place, along[value_name])
    return errors


def _error_of(values: Floats, stds: Floats, truth: Floats | float) -> dict[str, float]:
    """Return the rms of relative errors (n,), and of errors in standard uncertainties (n,)."""
    error = values - truth
    with np.errstate(all="ignore"):
        return {
            "truth": float(np.mean(truth)),
            "error": float(np.sqrt(np.mean((error / truth) ** 2))),
            "off": float(np.sqrt(np.mean((error / stds) ** 2))),
        }


def truth_along(pipeline: Pipeline, samples: Samples) -> Mapping[str, Floats] | None:
    """Return the truth (n,) at the place of each sample; None where the tip stayed at one place."""
    device = next(
        (candidate for candidate in pipeline.devices.values() if isinstance(candidate, KnowsTruthByPlace)), None
    )
    is_placed = samples.active & np.isfinite(samples.lateral).all(axis=1)
    if device is None or not is_placed.any() or float(np.ptp(samples.lateral[is_placed], axis=0).max()) <= _SWEEP:
        return None
    return device.truth_at(samples.lateral)


def _error_along(samples: Samples, blocks: Sequence[Estimates], place: int, truth: Floats) -> dict[str, float]:
    """Return the errors of a parameter's estimates along the way of the tip."""
    values, stds = (np.concatenate([getattr(block, key)[:, place] for block in blocks]) for key in ("values", "std"))
    status = np.concatenate([block.status for block in blocks])
    begin = float(samples.time[int(np.argmax(samples.active))]) + TrackComparison.WARM_UP
    rows = samples.active & (samples.time >= begin) & ((status & Status.IDLE) == 0) & np.isfinite(values)
    return _error_of(values[rows], stds[rows], truth[rows]) if rows.any() else {}
