"""What a comparison of many tracks shows: a table for each model, a CSV of all, and a picture of what can be used."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Mapping
from itertools import groupby
from typing import Any

from palpate_engine import Result, TrackResult, UncertainValue, display_unit, has_no_number, verdict_rank, verdict_word
from palpate_kit.figures import common_limits, figure_of, legend_outside, style
from palpate_kit.runs.run_folder import TrackTable
from palpate_kit.terminal.quantities import round_number, value_with_uncertainty
from palpate_kit.terminal.table import Table

_CURVES = 7  # in one panel


def tables(result: Result, refused: Mapping[str, str], details: bool) -> Iterator[Table | str]:
    """One table for each model, the best verdicts first; why tracks are in none (`refused`, by track); and counts.

    With `details` residual, NIS and flags, too.
    """
    ordered = sorted(result.tracks.items(), key=lambda item: (item[1].model, verdict_rank(item[1].verdict)))
    for model, group in groupby(ordered, key=lambda item: item[1].model):
        tracks = [track for _, track in group]
        units = {name: found.unit for track in tracks for name, found in track.parameters.items()}
        values = [f"{name}\n{display_unit(unit)[0]}" for name, unit in units.items()]
        rows = [_row(track, units, details) for track in tracks]
        if result.truth:
            known = [_true(result.truth.get(name), unit) for name, unit in units.items()]
            rows.append(["truth", *known, *([""] * (4 if details else 1))])
        more = ["residual\nN", "NIS", "flags"] if details else []
        headings = ["estimator", *values, "verdict", *more]
        yield Table.of(f"model {model}", headings, rows, ["estimator", "verdict", "flags"])
    failed = {
        name: flag.message for name, track in result.tracks.items() for flag in track.flags if flag.code == "failed"
    }
    for name, why in {**refused, **failed}.items():
        yield f"{name} has no result: {why}"
    usable = sum(track.usable for track in result.tracks.values())
    yield f"{usable} of {len(result.tracks) + len(refused)} usable"


def _row(track: TrackResult, units: Mapping[str, str], details: bool) -> list[str]:
    codes = "\n".join(dict.fromkeys(flag.code for flag in track.flags))
    values = [_shown(track.parameters.get(name)) if track.usable else "" for name in units]
    numbers = [f"{track.force_rms:.3f}", f"{track.nis:.2f}"] if track.usable else ["", ""]
    return [track.estimator, *values, verdict_word(track.verdict), *([*numbers, codes] if details else [])]


def _shown(found: UncertainValue | None) -> str:
    if found is not None and found.verdict == "invalid":
        return "none"
    factor = display_unit(found.unit)[1] if found else 1.0
    return value_with_uncertainty(found.value * factor, found.combined * factor) if found else ""


def _true(value: float | None, unit: str) -> str:
    return "" if value is None else round_number(value * display_unit(unit)[1])


def csv_text(result: Result, refused: Mapping[str, str]) -> str:
    """Every track in SI: a row for each parameter, with its uncertainty, verdict and flags."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(
        ["model", "estimator", "verdict", "parameter", "unit", "value", "std", "combined", "truth", "flags"]
    )
    for track in result.tracks.values():
        codes = " ".join(dict.fromkeys(flag.code for flag in track.flags))
        for name, found in track.parameters.items():
            value = None if has_no_number(found.verdict or "") else found.value
            numbers = [_number(number) for number in (value, found.std, found.combined, result.truth.get(name))]
            writer.writerow([track.model, track.estimator, track.verdict, name, found.unit, *numbers, codes])
    for name, why in refused.items():
        model, _, estimator = name.partition("/")
        writer.writerow([model, estimator, "not run", *([""] * 6), why])
    return text.getvalue()


def _number(value: float | None) -> str:
    return "" if value is None or not math.isfinite(value) else f"{value:.10g}"


@style()
def picture(result: Result, curves: Mapping[str, TrackTable], reference: str | None) -> Any:
    """Parameters over time with bands of two standard deviations: panels by model, at most eight tracks in each.

    Tracks that cannot be used are left out, so that none of them flattens the others.
    """
    panels = list(_panels(result, curves, reference))
    figure, axes = figure_of(2 if len(panels) > 1 else 1, max((len(panels) + 1) // 2, 1))
    for axis, (names, parameter, unit) in zip(axes.ravel(), panels):
        _draw(axis, {name: curves[name] for name in names}, parameter, unit, reference)
    for axis in axes.ravel()[len(panels) :]:
        axis.set_axis_off()
    return figure


def _panels(
    result: Result, curves: Mapping[str, TrackTable], reference: str | None
) -> Iterator[tuple[list[str], str, str]]:
    """Tracks, parameter and unit of each panel."""
    for model in dict.fromkeys(track.model for track in result.tracks.values()):
        tracks = {name: track for name, track in result.tracks.items() if track.model == model and name in curves}
        names = [name for name, track in tracks.items() if track.usable or name == reference]
        for begin in range(0, len(names), _CURVES):
            for parameter, found in tracks[names[begin]].parameters.items():
                yield names[begin : begin + _CURVES], parameter, found.unit


def _draw(axes: Any, curves: Mapping[str, TrackTable], parameter: str, unit: str, reference: str | None) -> None:
    word, factor = display_unit(unit)
    settled = []
    for label, table in curves.items():
        value, std = table.values[parameter] * factor, table.std[parameter] * factor
        look = {"color": "black", "linestyle": "-", "linewidth": 1.6} if label == reference else {}
        name = f"{label} (reference)" if label == reference else label
        (line,) = axes.plot(table.time, value, label=name, **look)
        axes.fill_between(table.time, value - 2 * std, value + 2 * std, color=line.get_color(), alpha=0.15, linewidth=0)
        settled.append(value[table.usable])
    axes.set(xlabel="time [s]", ylabel=f"{parameter} [{word}]")
    axes.set_ylim(common_limits(settled))
    legend_outside(axes)
