"""One curve for the page: measured, modelled, its rows; read and fitted in a process of its own."""

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

_LEAST_AIR = 10  # samples before contact that give a standard deviation
_MOST = 4000  # points that are sent; beyond, those of least and most force of each stretch


@dataclass(frozen=True)
class CurveAnswer:
    """What the page draws of a curve."""

    curve: str
    settings: str  # the fit was made with
    time: Floats  # (n,) [s]
    columns: NDArray[np.float32]  # (3, n): height [m], force [N], model's force [N]; NaN where not known
    rows: list[Row] = field(default_factory=list)  # empty where it was read only
    facts: dict[str, Any] = field(default_factory=dict)
    error: str = ""


def prepare_process() -> bool:
    """Nothing but the imports that a fit needs."""
    import casadi  # noqa: F401
    import palpate_kit.numerics.least_squares  # noqa: F401

    return True


def curve_answer(reader: CurveReader, curve: Curve, fitting: bool) -> CurveAnswer:
    """Return a curve as it was read, and fitted where that is asked for; one that cannot be has an error and its
    readings."""
    key = reader.key(curve.own)
    if fitting:
        try:
            outcome = curve_outcome(record_tracks(reader, curve.own), reader.device, curve)
            rows = [{**row, "settings": key} for row in outcome_rows(outcome, curve.name)]
            return CurveAnswer(curve.name, key, *_modelled(outcome), rows, _facts(outcome))
        except Exception as error:
            rows = [{**row, "settings": key} for row in error_rows(reader, curve, error)]
            raw = _readings(reader, curve)
            return CurveAnswer(curve.name, key, *raw, rows, {"raw": True}, rows[0]["error"])
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
    samples = outcome.samples
    force = np.full(len(samples), np.nan)
    name = str(outcome.pipeline.tracks[0].name)
    if outcome.result.tracks[name].usable:
        blocks = [block.force for block in outcome.estimates.get(name, ())]
        found = np.concatenate(blocks) if blocks else force
        force = found if len(found) == len(force) else force
    return _thin(samples.time, np.stack([samples.position, samples.force, force]))


def _facts(outcome: RecordOutcome) -> dict[str, Any]:
    """Surface [m], noise before contact [N] and flags of the first track, and its budget."""
    found = outcome.result.tracks[str(outcome.pipeline.tracks[0].name)]
    flags = [{"code": flag.code, "severity": flag.severity, "message": flag.message}
             for flag in (*outcome.result.flags, *found.flags)]  # fmt: skip
    surface = found.surface.value if found.usable and np.isfinite(found.surface.value) else None
    budget = [
        {"source": row.source, "percent": {name: effect.percent for name, effect in row.effects.items()}}
        for row in found.budget
    ]
    noise = _noise_before_contact(outcome.samples, surface)
    asked = [[fact.key, fact.effect] for fact in open_facts([found])] if found.usable else None
    facts: dict[str, Any] = finite_tree(
        {"raw": False, "surface": surface, "noise": noise, "flags": flags, "budget": budget, "open": asked}
    )
    return facts


def _noise_before_contact(samples: Samples, surface: float | None) -> float | None:
    """Standard deviation [N] of the force before the tip touches; None with too few samples.

    A touch shows in the force only once it is beyond the noise: above the surface that the fit found, too.
    """
    touched = samples.contact if surface is None else samples.contact | (samples.position <= surface)
    first = int(np.argmax(touched)) if touched.any() else len(samples)
    force = samples.force[:first]
    force = force[np.isfinite(force)]
    return float(force.std(ddof=1)) if len(force) >= _LEAST_AIR else None


def _readings(reader: CurveReader, curve: Curve) -> tuple[Floats, NDArray[np.float32]]:
    """Height and force as they were read, before any alignment; nothing where that fails, too."""
    nothing = np.zeros(0), np.zeros((3, 0), np.float32)
    try:
        pipeline = record_tracks(reader).pipeline
        device = curve.read_by(pipeline.devices[reader.device])
        with device.connect(0) as link:
            batches: Sequence[Batch] = list(link.batches())
        names = [channel.name for channel in device.streams[0].channels]
        wanted = [_channel(getattr(pipeline.alignment, role, None)) for role in ("position", "force")]
    except (PalpateError, OSError, ValueError, IndexError, StopIteration):
        return nothing
    batches = [batch for batch in batches if batch.stream == batches[0].stream] if batches else []
    if not batches:
        return nothing
    values = np.concatenate([batch.values for batch in batches])
    stamps = np.concatenate([batch.time for batch in batches]) - int(batches[0].time[0])
    time: Floats = np.asarray(1e-9 * stamps, dtype=np.float64)
    columns = [values[:, names.index(name)] if name in names else np.full(len(values), np.nan) for name in wanted]
    return _thin(time, np.stack([*columns, np.full(len(values), np.nan)]))


def _channel(signal: Any) -> str:
    """Return the channel of a signal of the alignment, without its device."""
    return str(getattr(signal, "channel", None) or "").rpartition(".")[2]


def _thin(time: Floats, columns: Floats) -> tuple[Floats, NDArray[np.float32]]:
    """At most so many points: of each stretch those of least and most force."""
    if len(time) > _MOST:
        edges = np.linspace(0, len(time), _MOST // 2 + 1).astype(int)
        force = np.nan_to_num(columns[1])
        ends = [(first + int(np.argmin(force[first:last])), first + int(np.argmax(force[first:last])))
                for first, last in pairwise(edges.tolist())]  # fmt: skip
        kept = np.unique(np.array(ends))
        time, columns = time[kept], columns[:, kept]
    return time, columns.astype(np.float32)
