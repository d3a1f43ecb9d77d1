"""Curves fitted one after the other in one process: what a run of each finds, as a row of a table."""

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
_KINDS = 16  # of settings of single curves whose tracks are kept in a process
_AT_LENGTH = {"profile": False, "bootstrap": 0}  # what no column of the table shows and no flag is raised from


@dataclass(frozen=True)
class CurveReader:
    """How curves are read and fitted, as plain data for any process."""

    text: str  # of the pipeline file
    path: str
    overrides: tuple[str, ...]
    device: str  # that has the file
    approved: frozenset[str] = frozenset()  # SHA-256 of the plugin files that any process may execute
    settings: str = ""  # the text of the settings file in the folder of the table

    def key(self, own: Sequence[str]) -> str:
        """What a row's settings are called: those of the folder, and a curve's own."""
        return settings_key(self.settings, own)


def settings_key(settings: str, own: Sequence[str]) -> str:
    """Return a short name for the text of a settings file with a curve's own settings on top."""
    return sha256("\n".join([settings, *own]).encode()).hexdigest()[:12]


def offline(pipeline: Pipeline) -> Pipeline:
    """Return the pipeline with its offline tracks only."""
    tracks = tuple(track for track in pipeline.tracks if not track.estimator.online)
    if not tracks:
        raise ConfigurationError(
            f'{pipeline.path}: has no offline estimator; add for example [estimator.fit] type = "casadi-fit"'
        )
    return replace(pipeline, tracks=tracks)


def value_units(model: ContactModel) -> dict[str, str]:
    """SI unit of each value that a model determines: of its parameters, then of what follows from them."""
    units = {parameter.name: parameter.unit for parameter in model.parameters}
    try:
        derived = {material.name: material.unit for material in model.material([1.0] * len(units))}
    except (ArithmeticError, ValueError):  # a model without a meaning at such numbers
        derived = {}
    return derived | units


@lru_cache(_KINDS)
def record_tracks(reader: CurveReader, own: tuple[str, ...] = (), at_length: bool = False) -> RecordTracks:
    """Return the offline tracks in this process; what they have compiled is kept from curve to curve.

    Unless `at_length`, without what no column of the table shows. Raises ConfigurationError.
    """
    source = Source(reader.text, Path(reader.path))
    name_tips(source)
    for assignment in reader.overrides:
        source.override(assignment)
    try:
        for assignment in own:
            source.override(assignment)
        with inherited_approval(reader.approved):
            pipeline = offline(build_pipeline(source))
    except ConfigurationError as error:
        if own:
            files = "own.toml, curves.csv or rig.toml" if any(text.startswith("rig.") for text in own) else "own.toml"
            raise ConfigurationError(f"{files}, {', '.join(own)}: {error}") from error
        raise
    return RecordTracks(pipeline if at_length else replace(pipeline, tracks=tuple(map(_for_a_row, pipeline.tracks))))


def _for_a_row(track: Track) -> Track:
    """Return the track without what no column of the table shows and no flag is raised from."""
    brief = {key: value for key, value in _AT_LENGTH.items() if key in type(track.estimator).model_fields}
    return replace(track, estimator=track.estimator.model_copy(update=brief)) if brief else track


def fit_curves(reader: CurveReader, curves: Sequence[Curve]) -> list[list[Row]]:
    """Return the rows of each curve, one for each offline track."""
    rows_of_curves = []
    for curve in curves:
        stated = {"settings": reader.key(curve.own)}
        if curve.place is not None:  # goes before a place that was measured, and is known of a curve that fails
            stated |= {axis: repr(number) for axis, number in zip("xy", curve.place, strict=True)}
        rows_of_curves.append([{**row, **stated} for row in _rows(reader, curve)])
    return rows_of_curves


def _rows(reader: CurveReader, curve: Curve) -> Iterator[Row]:
    try:
        outcome = curve_outcome(record_tracks(reader, curve.own), reader.device, curve)
    except Exception as error:  # one curve that breaks a part does not keep the others from their fit
        yield from error_rows(reader, curve, error)
        return
    yield from outcome_rows(outcome, curve.name)


def error_rows(reader: CurveReader, curve: Curve, error: Exception) -> Iterator[Row]:
    """Yield the rows of a curve that could not be fitted."""
    message = str(error) if isinstance(error, PalpateError) else f"{type(error).__name__}: {error}"
    if curve.file:  # the folder can be moved with its curves
        message = message.removeprefix(f"{curve.file}: ").replace(curve.file, curve.name)
    try:
        tracks = record_tracks(reader).pipeline.tracks
    except PalpateError:
        tracks = ()
    yield from (
        {"curve": curve.name, "track": name, "error": message} for name in [str(t.name) for t in tracks] or [""]
    )


def loss_rows(reader: CurveReader, curve: Curve, why: str) -> list[Row]:
    """Return the row of a curve whose process has ended before it was fitted; it names no track."""
    return [{"curve": curve.name, "settings": reader.key(curve.own), "error": why}]


def outcome_rows(outcome: RecordOutcome, curve: str) -> Iterator[Row]:
    """Yield the row of each track."""
    for track in outcome.pipeline.tracks:
        yield {"curve": curve, "track": str(track.name)} | _numbers(outcome, str(track.name))


def curve_outcome(tracks: RecordTracks, device: str, curve: Curve) -> RecordOutcome:
    """What is found of one curve; raises PalpateError."""
    devices: Mapping[str, Device] = tracks.pipeline.devices
    if curve.file:
        devices = {**devices, device: curve.read_by(devices[device])}
    batches = [(device, batch) for batch in curve.batches] if curve.batches else None
    return tracks.estimate(devices, batches, curve.name, detail=False)


def _numbers(outcome: RecordOutcome, name: str) -> Row:
    """Return the cells of a track: numbers where they may be used, its verdict, and every flag that concerns it."""
    found = outcome.result.tracks[name]
    table: dict[str, float] = {}
    if found.usable:
        table = dict(_values(found)) | dict(zip(("x", "y"), _place(outcome, name), strict=True))
    told = {key: repr(float(value)) for key, value in table.items() if np.isfinite(value)}
    told |= {f"{name}_verdict": value.verdict or "" for name, value in named_values(found).items()}
    said = (f"{one.fact}: {one.sentence(named_values(found)).replace('; ', ', ')}" for one in found.conditions)
    misfit = found.diagnoses.get("model-discrepancy", {})
    predicted = misfit.get("prediction", {}).get("error")
    told |= {} if predicted is None else {"prediction": repr(float(predicted))}
    told |= {key: repr(number) for key, number in motion_numbers(found.diagnoses.get("motion", {})).items()}
    told |= {"better_laws": " ".join(misfit.get("better_laws", ()))}
    told |= {"conditions": "; ".join(said), "needs": " ".join(_needed(found))}
    findings = track_row(found, name, of_record=outcome.result.flags).findings
    told |= {"findings": " | ".join(finding.cell for finding in findings)}
    flags: tuple[Flag, ...] = (*outcome.result.flags, *found.flags)
    failed = next((flag.message for flag in found.flags if flag.code == "failed"), "")
    codes = " ".join(sorted({flag.code for flag in flags}))
    return told | {"verdict": found.verdict, "samples": str(found.samples), "flags": codes, "error": failed}


def named_values(found: TrackResult) -> dict[str, UncertainValue]:
    """Return the values by name, those that follow from the parameters first."""
    return {**{value.name: value.found for value in found.derived}, **found.parameters}


def row_conditions(row: Mapping[str, str]) -> dict[str, str]:
    """Return the facts that nobody has stated, with what is assumed of each and its effect, of a row of fits."""
    entries = (entry.partition(": ") for entry in (row.get("conditions") or "").split("; ") if entry)
    return {fact: sentence for fact, _, sentence in entries}


def _needed(found: TrackResult) -> list[str]:
    """Return the facts that values of a track need, each once."""
    words = [value.verdict or "" for value in named_values(found).values()]
    return list(dict.fromkeys(word.removeprefix("needs ") for word in words if word.startswith("needs ")))


def _values(found: TrackResult) -> Iterator[tuple[str, float]]:
    for name, value in {**named_values(found), "surface": found.surface}.items():
        if value.verdict == "invalid":
            continue
        yield name, value.value
        yield f"{name}_std", value.std
        yield f"{name}_combined", value.combined
    yield "rms", found.report.rms if found.report is not None else found.force_rms


def _place(outcome: RecordOutcome, name: str) -> Floats:
    """Mean place (2,) [m] of what was fitted; NaN where it is not known."""
    used = np.concatenate([np.isfinite(block.values).all(axis=1) for block in outcome.estimates[name]])
    place = outcome.samples.lateral[used]
    known = place[np.isfinite(place).all(axis=1)]
    return np.asarray(known.mean(axis=0)) if len(known) else np.full(2, np.nan)
