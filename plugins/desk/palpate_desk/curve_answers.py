"""Answers of the process that reads and fits one curve for the page: its samples, its model, its rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import Batch, Floats, PalpateError, Samples
from palpate_engine import RecordOutcome, Source, build_pipeline, finite_tree, inherited_approval, resolved_text
from palpate_kit.curves.curve import Curve
from palpate_kit.curves.curve_fits import (
    CurveReader,
    Row,
    curve_outcome,
    error_rows,
    outcome_rows,
    record_tracks,
)
from palpate_kit.curves.open_facts import open_facts
from palpate_kit.runs.replay_source import replace_model

_MIN_AIR_SAMPLES = 10  # before contact, a choice: fewer give no standard deviation
_MAX_POINTS = 4000  # that are sent, a choice: two for each column of pixels of a wide screen
_NANOSECOND = 1e-9  # [s]


@dataclass(frozen=True)
class CurveAnswer:
    """Samples, model and rows of a curve for the page."""

    curve: str
    settings: str  # digest of the settings of the fit; empty for one that was only read
    time: Floats  # (n,) [s]
    columns: NDArray[np.float32]  # (3, n): height [m], force [N], model's force [N]; NaN where not known
    rows: list[Row] = field(default_factory=list)  # of the fit; empty for a curve that was only read
    facts: dict[str, Any] = field(default_factory=dict)
    error: str = ""


def prepare_process() -> bool:
    """Import what a fit needs, and return True."""
    import casadi  # noqa: F401
    import palpate_kit.numerics.least_squares  # noqa: F401

    return True


def curve_answer(reader: CurveReader, curve: Curve, fitting: bool) -> CurveAnswer:
    """Return a curve fitted with its settings, or only read; one that cannot be fitted has readings and an error."""
    key = reader.key(curve.own)
    if fitting:
        try:
            outcome = curve_outcome(record_tracks(reader, curve.own), reader.device, curve)
            rows = [{**row, "settings": key} for row in outcome_rows(outcome, curve.name)]
            return CurveAnswer(curve.name, key, *_modelled(outcome), rows, _facts(outcome))
        except Exception as error:
            rows = [{**row, "settings": key} for row in error_rows(reader, curve, error)]
            return CurveAnswer(curve.name, key, *_readings(reader, curve), rows, {"raw": True}, rows[0]["error"])
    return CurveAnswer(curve.name, "", *_readings(reader, curve), [], {"raw": True})


def reader_with_model(reader: CurveReader, model: str) -> CurveReader:
    """Return the reader whose curves are fitted with another model on the same tip; raises ConfigurationError."""
    source = Source(reader.text, Path(reader.path))
    for assignment in reader.overrides:
        source.override(assignment)
    replace_model(source, model)
    with inherited_approval(reader.approved):
        return replace(reader, text=resolved_text(build_pipeline(source)))


def _modelled(outcome: RecordOutcome) -> tuple[Floats, NDArray[np.float32]]:
    """Return time (n,) [s] and columns (3, n) of a fit, as in `CurveAnswer`; without a usable fit the model is NaN."""
    samples = outcome.samples
    force = np.full(len(samples), np.nan)
    track = str(outcome.pipeline.tracks[0].name)
    blocks = [block.force for block in outcome.estimates.get(track, ())]
    if outcome.result.tracks[track].usable and sum(map(len, blocks)) == len(force):
        force = np.concatenate(blocks) if blocks else force
    return _thinned(samples.time, np.stack([samples.position, samples.force, force]))


def _facts(outcome: RecordOutcome) -> dict[str, Any]:
    """Return surface [m], noise before contact [N], flags, budget and open facts of the first track, for the page.

    "raw" is True for a curve that was only read. The budget has the share [%] of each source by value.
    """
    track = outcome.result.tracks[str(outcome.pipeline.tracks[0].name)]
    flags = [
        {"code": flag.code, "severity": flag.severity, "message": flag.message}
        for flag in (*outcome.result.flags, *track.flags)
    ]
    surface = track.surface.value if track.usable and np.isfinite(track.surface.value) else None
    budget = [
        {"source": row.source, "percent": {name: effect.percent for name, effect in row.effects.items()}}
        for row in track.budget
    ]
    facts: dict[str, Any] = finite_tree(
        {
            "raw": False,
            "surface": surface,
            "noise": _noise_before_contact(outcome.samples, surface),
            "flags": flags,
            "budget": budget,
            "open": [[fact.key, fact.effect] for fact in open_facts([track])] if track.usable else None,
        }
    )
    return facts


def _noise_before_contact(samples: Samples, surface: float | None) -> float | None:
    """Return the standard deviation [N] of the force before the tip touches; None for too few samples.

    The force shows a touch only once it exceeds the noise, so that the surface [m] of the fit ends the air, too.
    """
    is_touching = samples.contact if surface is None else samples.contact | (samples.position <= surface)
    onset_index = int(np.argmax(is_touching)) if is_touching.any() else len(samples)
    air_force = samples.force[:onset_index]
    air_force = air_force[np.isfinite(air_force)]
    return float(air_force.std(ddof=1)) if len(air_force) >= _MIN_AIR_SAMPLES else None


def _readings(reader: CurveReader, curve: Curve) -> tuple[Floats, NDArray[np.float32]]:
    """Return time (n,) [s] and columns (3, n) of a curve as its device reads it, before any alignment.

    The columns are height [m], force [N], and the model's force, which is NaN. Both are empty where reading fails, too.
    """
    empty = np.zeros(0), np.zeros((3, 0), np.float32)
    try:
        pipeline = record_tracks(reader).pipeline
        device = curve.read_by(pipeline.devices[reader.device])
        with device.connect(0) as link:
            batches: Sequence[Batch] = list(link.batches())
        channels = [channel.name for channel in device.streams[0].channels]
        names = [_channel_name(getattr(pipeline.alignment, role, None)) for role in ("position", "force")]
    except (PalpateError, OSError, ValueError, IndexError, StopIteration):
        return empty
    batches = [batch for batch in batches if batch.stream == batches[0].stream] if batches else []
    if not batches:
        return empty
    # Time from the first reading on.
    values = np.concatenate([batch.values for batch in batches])
    stamps = np.concatenate([batch.time for batch in batches]) - int(batches[0].time[0])
    time: Floats = np.asarray(_NANOSECOND * stamps, dtype=np.float64)
    missing = np.full(len(values), np.nan)
    height, force = (values[:, channels.index(name)] if name in channels else missing for name in names)
    return _thinned(time, np.stack([height, force, missing]))


def _channel_name(signal: Any) -> str:
    """Return the channel of a signal of the alignment, without its device; empty without one."""
    return str(getattr(signal, "channel", None) or "").rpartition(".")[2]


def _thinned(time: Floats, columns: Floats) -> tuple[Floats, NDArray[np.float32]]:
    """Return at most `_MAX_POINTS` of n points: those of lowest and highest force in each of half as many intervals."""
    if len(time) > _MAX_POINTS:
        edges = np.linspace(0, len(time), _MAX_POINTS // 2 + 1).astype(int)
        force = np.nan_to_num(columns[1])
        extremes = []
        for first, last in pairwise(edges.tolist()):
            interval = force[first:last]
            extremes += [first + int(np.argmin(interval)), first + int(np.argmax(interval))]
        rows = np.unique(np.array(extremes))
        time, columns = time[rows], columns[:, rows]
    return time, columns.astype(np.float32)
