"""Curves fitted one after the other in one process: what a run of each finds, as a row of a table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from palpate import ContactModel, Device, Estimator, Flag, Floats, PalpateError
from palpate.host import (
    RecordOutcome,
    RecordTracks,
    Source,
    Track,
    TrackResult,
    UncertainValue,
    build_pipeline,
    inherited_approval,
)

from palpate_fits.curves import Curve
from palpate_fits.estimator import CasadiFit
from palpate_fits.fit_sources import offline

Row = dict[str, str]


@dataclass(frozen=True)
class CurveReader:
    """How curves are read and fitted, as plain data for any process."""

    text: str  # of the pipeline file
    path: str
    overrides: tuple[str, ...]
    device: str  # that has the file
    approved: frozenset[str] = frozenset()  # SHA-256 of the plugin files that any process may execute


def value_units(model: ContactModel) -> dict[str, str]:
    """SI unit of each value that a model determines: of its parameters, then of what follows from them."""
    units = {parameter.name: parameter.unit for parameter in model.parameters}
    try:
        derived = {material.name: material.unit for material in model.material([1.0] * len(units))}
    except (ArithmeticError, ValueError):  # a model without a meaning at such numbers
        derived = {}
    return derived | units


@cache
def _tracks(reader: CurveReader) -> RecordTracks:
    """The offline tracks in this process; what they have compiled is kept from curve to curve."""
    source = Source(reader.text, Path(reader.path))
    for assignment in reader.overrides:
        source.override(assignment)
    with inherited_approval(reader.approved):
        pipeline = offline(build_pipeline(source))
    return RecordTracks(replace(pipeline, tracks=tuple(map(_for_a_row, pipeline.tracks))))


def _for_a_row(track: Track) -> Track:
    """The track without what no column of the table shows and no flag is raised from."""
    estimator: Estimator = track.estimator
    if isinstance(estimator, CasadiFit):
        return replace(track, estimator=estimator.model_copy(update={"profile": False, "bootstrap": 0}))
    return track


def fit_curves(reader: CurveReader, curves: Sequence[Curve]) -> list[list[Row]]:
    """The rows of each curve, one for each offline track."""
    return [list(_rows(_tracks(reader), reader.device, curve)) for curve in curves]


def _rows(tracks: RecordTracks, device: str, curve: Curve) -> Iterator[Row]:
    names = [track.name for track in tracks.pipeline.tracks]
    try:
        outcome = _outcome(tracks, device, curve)
    except PalpateError as error:
        yield from ({"curve": curve.name, "track": str(name), "error": str(error)} for name in names)
        return
    except Exception as error:  # one curve that breaks a part does not keep the others from their fit
        told = f"{type(error).__name__}: {error}"
        yield from ({"curve": curve.name, "track": str(name), "error": told} for name in names)
        return
    for name in names:
        yield {"curve": curve.name, "track": str(name)} | _numbers(outcome, name)


def _outcome(tracks: RecordTracks, device: str, curve: Curve) -> RecordOutcome:
    devices: Mapping[str, Device] = tracks.pipeline.devices
    if curve.file:
        devices = {**devices, device: devices[device].model_copy(update={"file": Path(curve.file)})}
    batches = [(device, batch) for batch in curve.batches] if curve.batches else None
    return tracks.estimate(devices, batches, curve.name, provenance=False)


def _numbers(outcome: RecordOutcome, name: str) -> Row:
    """The cells of a track: numbers where they may be used, its verdict, and every flag that concerns it."""
    found = outcome.result.tracks[name]
    table: dict[str, float] = {}
    if found.usable:
        table = dict(_values(found)) | dict(zip(("x", "y"), _place(outcome, name), strict=True))
    told = {key: repr(float(value)) for key, value in table.items() if np.isfinite(value)}
    flags: tuple[Flag, ...] = (*outcome.result.flags, *found.flags)
    failed = next((flag.message for flag in found.flags if flag.code == "failed"), "")
    codes = " ".join(sorted({flag.code for flag in flags}))
    return told | {"verdict": found.verdict, "samples": str(found.samples), "flags": codes, "error": failed}


def _values(found: TrackResult) -> Iterator[tuple[str, float]]:
    values: dict[str, UncertainValue] = {value.name: value.found for value in found.derived}
    for name, value in {**values, **found.parameters, "surface": found.surface}.items():
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
