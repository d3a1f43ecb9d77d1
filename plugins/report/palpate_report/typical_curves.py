"""Curves of a folder that are drawn: the best, the middle and the worst by their residual, and those not used."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from palpate import Floats, PalpateError
from palpate_engine import RecordOutcome
from palpate_kit.curves.curve_fits import curve_outcome, record_tracks
from palpate_kit.curves.curve_pipelines import curve_reader
from palpate_kit.curves.curve_row import CurveRow
from palpate_kit.curves.fit_folder import FitFolder
from palpate_kit.figures import WIDTHS, figure_of, style

from palpate_report.figure_data import thin_rows
from palpate_report.folder_facts import FolderFacts, exclusion_of

# Choices.
_COLUMNS = 3  # panels side by side
_MAX_EXCLUDED = 6  # curves that are not used, of which each reason has one first
_MAX_POINTS = 1500  # of a curve
_MAX_LETTERS = 34  # of a title
_USED_HEIGHT, _EXCLUDED_HEIGHT = 44.0, 48.0  # [mm] of a row of panels


@dataclass(frozen=True)
class CurveDrawing:
    """One curve: measured and modelled force (n,) [N] over depth (n,) [m] below the surface of its fit."""

    title: str
    depth: Floats
    force: Floats
    model: Floats  # NaN without one
    error: str = ""  # why there is nothing to draw


def ranked_rows(facts: FolderFacts) -> dict[str, CurveRow]:
    """Return the used rows of least, middle and largest residual, as many as there are, by what they are called."""
    fitted = [row for row in facts.used if row.number("rms") is not None]
    fitted.sort(key=lambda row: (row.number("rms"), row.curve))
    last = len(fitted) - 1
    places = {"best": 0, "median": last // 2, "worst": last}
    return {name: fitted[place] for name, place in places.items() if fitted and (name == "worst" or place < last)}


def excluded_rows(facts: FolderFacts) -> list[CurveRow]:
    """Rows that are not used: of each reason one, then others."""
    excluded = [row for row in facts.rows if not row.usable]
    first = {exclusion_of(row): row for row in reversed(excluded)}
    firsts = [row for row in excluded if first[exclusion_of(row)] is row]
    return [*firsts, *(row for row in excluded if row not in firsts)][:_MAX_EXCLUDED]


def outcome_of(folder: FitFolder, curve: str) -> RecordOutcome:
    """Return the outcome of the fit of a curve, made again from its file; raises PalpateError."""
    reader, settings = curve_reader(folder, folder.dialect_of(curve)), folder.settings_of(curve)
    return curve_outcome(record_tracks(reader, settings), reader.device, folder.curve(curve))


def drawing(folder: FitFolder, row: CurveRow, rank: str) -> CurveDrawing:
    """Return a curve as its fit sees it, fitted again; `rank`, such as "best", begins its title.

    The force is measured, less the offset that the fit has found. A curve that cannot be read has an error.
    """
    title = f"{rank}: {_short(row.curve)}"
    nothing = np.zeros(0)
    file = folder.file_of(row.curve)
    if not file or not Path(file).exists():
        return CurveDrawing(title, nothing, nothing, nothing, "its file is not here")
    try:
        outcome = outcome_of(folder, row.curve)
    except PalpateError as error:
        return CurveDrawing(title, nothing, nothing, nothing, str(error).replace(file, row.curve))
    samples, name = outcome.samples, row.track or str(outcome.pipeline.tracks[0].name)
    track = outcome.result.tracks[name]
    blocks = [block.force for block in outcome.estimates.get(name, ())]
    model = np.concatenate(blocks) if track.usable and blocks else np.full(len(samples), np.nan)
    # Without a usable surface the depth counts from the highest position.
    surface = track.surface.value if track.usable and np.isfinite(track.surface.value) else np.nanmax(samples.position)
    # What a fit takes for offset and drift is not a force of the contact.
    bias = track.report.table().get("bias", 0.0) if track.report is not None else 0.0
    kept = thin_rows(len(samples), _MAX_POINTS)
    return CurveDrawing(title, (surface - samples.position)[kept], (samples.force - bias)[kept], model[kept])


def _short(name: str) -> str:
    return name if len(name) <= _MAX_LETTERS else f"...{name[3 - _MAX_LETTERS :]}"


@style()
def used_curves_figure(drawings: Sequence[CurveDrawing]) -> Any:
    """Return a figure of force with its model over depth, and the residual below, of curves side by side.

    Sizes of marks and widths of lines are in points.
    """
    figure, axes = figure_of(len(drawings), 2, width=WIDTHS["double"], height=_USED_HEIGHT)
    for column, curve in enumerate(drawings):
        above, below = axes[0, column], axes[1, column]
        _draw_force(above, curve)
        below.plot(1e3 * curve.depth, 1e3 * (curve.force - curve.model), ".", markersize=1.5, color="C1")
        below.axhline(0.0, color="black", linewidth=0.5)
        below.set(xlabel="depth [mm]")
        above.sharex(below)
    axes[0, 0].set(ylabel="force [N]")
    axes[1, 0].set(ylabel="residual [mN]")
    axes[0, 0].legend(loc="upper left")
    return figure


@style()
def excluded_curves_figure(drawings: Sequence[CurveDrawing]) -> Any:
    """Return a figure of force over depth of curves that are not used, at most three side by side."""
    columns = min(_COLUMNS, len(drawings))
    rows = -(-len(drawings) // columns)
    figure, axes = figure_of(columns, rows, width=WIDTHS["double"] * columns / _COLUMNS, height=_EXCLUDED_HEIGHT)
    for axis, curve in zip(axes.ravel(), drawings, strict=False):
        _draw_force(axis, curve)
        axis.set(xlabel="depth [mm]")
    for axis in axes.ravel()[len(drawings) :]:
        axis.set_axis_off()
    for row in axes:
        row[0].set(ylabel="force [N]")
    return figure


def _draw_force(axis: Any, curve: CurveDrawing) -> None:
    axis.set_title(curve.title, fontsize="small")
    if curve.error:
        axis.text(0.5, 0.5, "nothing to draw", ha="center", va="center", transform=axis.transAxes)
        return
    axis.plot(1e3 * curve.depth, curve.force, ".", markersize=1.5, color="C0", label="measured")
    if np.isfinite(curve.model).any():
        axis.plot(1e3 * curve.depth, curve.model, "-", color="black", linewidth=0.9, label="model")


def captions(rows: Mapping[str, CurveRow]) -> Iterator[str]:
    """Of each drawn curve its residual."""
    for rank, row in rows.items():
        yield f"{rank}: {row.curve}, residual {1e3 * (row.number('rms') or 0.0):.3g} mN RMS"
