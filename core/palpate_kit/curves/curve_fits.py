"""Curves fitted one after the other in one process: the estimates of each become rows of a table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from hashlib import sha256
from pathlib import Path

import numpy as np
from palpate import ConfigurationError, ContactModel, Device, Flag, Floats, PalpateError
from palpate_engine import (
    Pipeline,
    RecordOutcome,
    RecordTracks,
    Source,
    Track,
    TrackResult,
    UncertainValue,
    build_pipeline,
    inherited_approval,
)

from palpate_kit.curves.curve import Curve
from palpate_kit.runs.shared_tips import name_tips
from palpate_kit.terminal.motion_text import motion_numbers
from palpate_kit.terminal.result_table import track_row

Row = dict[str, str]
_CACHED_SETTINGS = 16  # different settings of curves whose compiled tracks a process keeps: a choice
_KEY_DIGITS = 12  # of a SHA-256, which distinguish the settings of a folder: a choice
# Settings of an estimator without computations that no column of the table shows and no flag is raised from.
_BRIEF_SETTINGS = {"profile": False, "bootstrap": 0}


@dataclass(frozen=True)
class CurveReader:
    """A pipeline that reads and fits curves, as plain data for any process."""

    text: str  # of the pipeline file
    path: str
    overrides: tuple[str, ...]
    device: str  # name of the device that reads the file
    approved: frozenset[str] = frozenset()  # SHA-256 of the plugin files that any process may execute
    settings: str = ""  # the text of the settings file in the folder of the table

    def key(self, assignments: Sequence[str]) -> str:
        """Return the key of the settings of a curve: those of the folder, then its own assignments."""
        return settings_key(self.settings, assignments)


def settings_key(settings: str, assignments: Sequence[str]) -> str:
    """Return a short key of the text of a settings file followed by a curve's own assignments."""
    return sha256("\n".join([settings, *assignments]).encode()).hexdigest()[:_KEY_DIGITS]


def offline(pipeline: Pipeline) -> Pipeline:
    """Return the pipeline with its offline tracks only."""
    tracks = tuple(track for track in pipeline.tracks if not track.estimator.online)
    if not tracks:
        raise ConfigurationError(
            f'{pipeline.path}: has no offline estimator; add for example [estimator.fit] type = "casadi-fit"'
        )
    return replace(pipeline, tracks=tracks)


def value_units(model: ContactModel) -> dict[str, str]:
    """Return the SI unit of each value that a model determines: of its parameters, then of what follows from them."""
    units = {parameter.name: parameter.unit for parameter in model.parameters}
    try:
        # Any parameters will do: the names and units of what follows from them are always the same.
        derived = {material.name: material.unit for material in model.material([1.0] * len(units))}
    except (ArithmeticError, ValueError):  # a model that is not defined at these parameters
        derived = {}
    return derived | units


@lru_cache(_CACHED_SETTINGS)
def record_tracks(reader: CurveReader, assignments: tuple[str, ...] = (), at_length: bool = False) -> RecordTracks:
    """Return the offline tracks of a curve; compiled code is kept from curve to curve.

    `reader` is a pipeline that reads and fits curves, as plain data. `assignments` are settings of this curve alone, as
    of ``--set``. Unless `at_length`, the tracks compute nothing that no column of the table shows. Raises
    ConfigurationError, which names the files that may state an assignment.
    """
    source = Source(reader.text, Path(reader.path))
    name_tips(source)
    for assignment in reader.overrides:
        source.override(assignment)
    try:
        # The assignments of a curve come last; an error in them names their files.
        for assignment in assignments:
            source.override(assignment)
        with inherited_approval(reader.approved):
            pipeline = offline(build_pipeline(source))
    except ConfigurationError as error:
        if not assignments:
            raise
        has_facts = any(text.startswith("rig.") for text in assignments)
        files = "own.toml, curves.csv or rig.toml" if has_facts else "own.toml"
        raise ConfigurationError(f"{files}, {', '.join(assignments)}: {error}") from error
    if not at_length:
        pipeline = replace(pipeline, tracks=tuple(map(_brief_track, pipeline.tracks)))
    return RecordTracks(pipeline)


def _brief_track(track: Track) -> Track:
    """Return the track without computations that no column of the table shows and no flag is raised from."""
    settings = {key: value for key, value in _BRIEF_SETTINGS.items() if key in type(track.estimator).model_fields}
    if not settings:
        return track
    return replace(track, estimator=track.estimator.model_copy(update=settings))


def fit_curves(reader: CurveReader, curves: Sequence[Curve]) -> list[list[Row]]:
    """Return the rows of each curve, one for each offline track."""
    rows_of_curves = []
    for curve in curves:
        stated = {"settings": reader.key(curve.own)}
        if curve.place is not None:  # overrides a measured place, and is known of a curve whose fit fails
            stated |= {axis: repr(number) for axis, number in zip("xy", curve.place, strict=True)}
        rows_of_curves.append([{**row, **stated} for row in _rows_of_curve(reader, curve)])
    return rows_of_curves


def _rows_of_curve(reader: CurveReader, curve: Curve) -> Iterator[Row]:
    try:
        outcome = curve_outcome(record_tracks(reader, curve.own), reader.device, curve)
    except Exception as error:  # a part that fails on one curve must not stop the fits of the others
        yield from error_rows(reader, curve, error)
        return
    yield from outcome_rows(outcome, curve.name)


def error_rows(reader: CurveReader, curve: Curve, error: Exception) -> Iterator[Row]:
    """Yield the rows of a curve that could not be fitted."""
    message = str(error) if isinstance(error, PalpateError) else f"{type(error).__name__}: {error}"
    if curve.file:  # a path would be wrong once the folder is moved with its curves
        message = message.removeprefix(f"{curve.file}: ").replace(curve.file, curve.name)
    try:
        names = [str(track.name) for track in record_tracks(reader).pipeline.tracks]
    except PalpateError:  # the pipeline cannot be built: one row, without a track
        names = []
    for name in names or [""]:
        yield {"curve": curve.name, "track": name, "error": message}


def loss_rows(reader: CurveReader, curve: Curve, reason: str) -> list[Row]:
    """Return the row of a curve whose process has ended before it was fitted; it names no track."""
    return [{"curve": curve.name, "settings": reader.key(curve.own), "error": reason}]


def outcome_rows(outcome: RecordOutcome, curve: str) -> Iterator[Row]:
    """Yield the row of each track."""
    for track in outcome.pipeline.tracks:
        yield {"curve": curve, "track": str(track.name)} | _track_cells(outcome, str(track.name))


def curve_outcome(tracks: RecordTracks, device: str, curve: Curve) -> RecordOutcome:
    """Estimate the tracks of one curve, from its file or its readings; raises PalpateError."""
    devices: Mapping[str, Device] = tracks.pipeline.devices
    if curve.file:
        devices = {**devices, device: curve.read_by(devices[device])}
    batches = [(device, batch) for batch in curve.batches] if curve.batches else None
    return tracks.estimate(devices, batches, curve.name, detail=False)


def _track_cells(outcome: RecordOutcome, name: str) -> Row:
    """Return the cells of a track in ``fits.csv``: numbers [SI] if it is usable, its verdicts, and every flag on it.

    `outcome` has the samples and the results of all tracks of a curve.
    """
    track = outcome.result.tracks[name]
    flags: tuple[Flag, ...] = (*outcome.result.flags, *track.flags)
    numbers: dict[str, float] = {}
    if track.usable:
        numbers = dict(_value_numbers(track)) | dict(zip(("x", "y"), _mean_place(outcome, name), strict=True))
    # Numbers in full, then what a reader needs to judge them.
    cells = {key: repr(float(number)) for key, number in numbers.items() if np.isfinite(number)}
    cells |= {f"{key}_verdict": value.verdict or "" for key, value in named_values(track).items()}
    cells |= _diagnosis_cells(track)
    cells |= {"conditions": "; ".join(_condition_entries(track)), "needs": " ".join(_needed_facts(track))}
    # The flags in sentences, as in the table of results.
    findings = track_row(track, name, of_record=outcome.result.flags).findings
    cells |= {"findings": " | ".join(finding.cell for finding in findings)}
    cells |= {"verdict": track.verdict, "samples": str(track.samples)}
    cells |= {"flags": " ".join(sorted({flag.code for flag in flags}))}
    cells |= {"error": next((flag.message for flag in track.flags if flag.code == "failed"), "")}
    return cells


def _diagnosis_cells(track: TrackResult) -> Row:
    """Return the cells of the error of the prediction, of the motion, and of the laws that fit better."""
    discrepancy = track.diagnoses.get("model-discrepancy", {})
    prediction_error = discrepancy.get("prediction", {}).get("error")
    cells = {} if prediction_error is None else {"prediction": repr(float(prediction_error))}
    cells |= {key: repr(number) for key, number in motion_numbers(track.diagnoses.get("motion", {})).items()}
    cells |= {"better_laws": " ".join(discrepancy.get("better_laws", ()))}
    return cells


def _condition_entries(track: TrackResult) -> Iterator[str]:
    """Yield each open fact with its sentence, which has no semicolon: that separates the entries of the cell."""
    values = named_values(track)
    for condition in track.conditions:
        yield f"{condition.fact}: {condition.sentence(values).replace('; ', ', ')}"


def named_values(track: TrackResult) -> dict[str, UncertainValue]:
    """Return the values by name, those that follow from the parameters first."""
    return {**{value.name: value.found for value in track.derived}, **track.parameters}


def row_conditions(row: Mapping[str, str]) -> dict[str, str]:
    """Return the facts that nobody has stated, with what is assumed of each and its effect, of a row of fits."""
    entries = (entry.partition(": ") for entry in (row.get("conditions") or "").split("; ") if entry)
    return {fact: sentence for fact, _, sentence in entries}


def _needed_facts(track: TrackResult) -> list[str]:
    """Return the facts that values of a track need, each once."""
    verdicts = [value.verdict or "" for value in named_values(track).values()]
    return list(dict.fromkeys(text.removeprefix("needs ") for text in verdicts if text.startswith("needs ")))


def _value_numbers(track: TrackResult) -> Iterator[tuple[str, float]]:
    """Yield column and number [SI] of each value that is not invalid, of its uncertainties, and of the rms [N]."""
    for name, value in {**named_values(track), "surface": track.surface}.items():
        if value.verdict == "invalid":
            continue
        yield name, value.value
        yield f"{name}_std", value.std
        yield f"{name}_combined", value.combined
    yield "rms", track.report.rms if track.report is not None else track.force_rms


def _mean_place(outcome: RecordOutcome, name: str) -> Floats:
    """Return the mean place (2,) [m] of the samples with an estimate; NaN if no place is known."""
    is_estimated = np.concatenate([np.isfinite(block.values).all(axis=1) for block in outcome.estimates[name]])
    places = outcome.samples.lateral[is_estimated]
    places = places[np.isfinite(places).all(axis=1)]
    return np.asarray(places.mean(axis=0)) if len(places) else np.full(2, np.nan)
