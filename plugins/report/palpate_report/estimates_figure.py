"""The estimates of a run over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from palpate import Floats
from palpate_engine import display_unit
from palpate_kit.figures import common_limits, figure_of, legend_outside

from palpate_report.figure_data import Curves, swept, thin_rows
from palpate_report.figure_subject import BAND_OPACITY, MAX_POINTS, MAX_TRACKS, ReportFigure, Subject, beside

# Choices of how it looks.
_MAX_PANELS = 8  # of a figure: they fit a page
_HEIGHT = 48.0  # [mm] of a row of panels
_BAR_DISTANCE = 0.02  # of the first bar behind the end of its curve, of the curve's duration
_BAR_STEP = 0.015  # from one bar to the next, likewise
_BAR_ROOM = 1.1  # of a bar's half length that the axis shows
_SETTLED_FROM = 0.5  # share of a curve before which it does not scale the axis
_SETTLED_FROM_SWEPT = 0.1  # likewise of a sweep, which has a value of its own at every place


def estimates(subject: Subject) -> ReportFigure | None:
    """Return a figure of every parameter over time with bands of two standard deviations, in a panel for each model.

    `subject` is a run with its tracks, and the width of its pictures. The truth is drawn where it is known. None
    without an estimate.
    """
    panels = _panels(subject)[:_MAX_PANELS]
    if not panels:
        return None
    columns = beside(subject, len(panels))
    figure, axes = figure_of(columns, -(-len(panels) // columns), width=subject.width, height=_HEIGHT)
    data: dict[str, Floats] = {}
    for axis, (names, parameter) in zip(axes.ravel(), panels, strict=False):
        data |= _draw_estimates(axis, subject, names, parameter)
    for axis in axes.ravel()[len(panels) :]:
        axis.set_axis_off()
    _shared_legends(axes.ravel()[: len(panels)])
    caption = "Estimates over time with bands of two of the estimator's standard deviations; bars: two combined u"
    return ReportFigure(figure, caption, data)


def _panels(subject: Subject) -> list[tuple[list[str], str]]:
    """Return track names and parameter of each panel: tracks of one model, which have an estimate, share a panel."""
    by_model: dict[tuple[str, str], list[str]] = {}
    for name in subject.tracks:
        curves = subject.curves(name)
        model = name.partition("/")[0]
        for parameter in curves.values if curves.used.any() else ():
            by_model.setdefault((model, parameter), []).append(name)
    return [(names[:MAX_TRACKS], parameter) for (_, parameter), names in by_model.items()]


@dataclass
class _Panel:
    """The panel of one parameter while it is drawn, in the unit of the figure; `factor` is how many of it an SI unit
    is."""

    axis: Any
    parameter: str
    factor: float
    settled: list[Floats] = field(default_factory=list)  # later parts of the curves, which decide on the limits
    bars: list[tuple[float, float]] = field(default_factory=list)  # value and half length, two combined uncertainties

    def draw_curve(self, curves: Curves, estimate: Mapping[str, Any] | None) -> dict[str, Floats]:
        """Draw the curve of a track with its band, and a bar at its end for an estimate of a result.

        Return the points by column [SI].
        """
        used = np.flatnonzero(curves.used)
        rows = used[thin_rows(len(used), MAX_POINTS // 2)]  # a choice: a band is drawn as well
        if not len(rows):
            return {}
        time = curves.time[rows]
        value = self.factor * curves.values[self.parameter][rows]
        std = self.factor * curves.std[self.parameter][rows]
        (line,) = self.axis.plot(time, value, label=curves.name)
        self.axis.fill_between(
            time, value - 2 * std, value + 2 * std, color=line.get_color(), alpha=BAND_OPACITY, linewidth=0
        )
        self.settled.append(self.factor * curves.values[self.parameter][curves.settled])
        if estimate and estimate["value"] is not None and estimate.get("combined"):
            # Bars of several tracks stand one behind the other.
            distance = (_BAR_DISTANCE + _BAR_STEP * len(self.bars)) * np.ptp(time)
            self._draw_bar(time[-1] + distance, estimate, line.get_color())
        prefix = f"{curves.name}:"
        return {
            f"{prefix}time_s": time,
            f"{prefix}{self.parameter}": value / self.factor,
            f"{prefix}{self.parameter}_std": std / self.factor,
        }

    def _draw_bar(self, time: float, estimate: Mapping[str, Any], colour: str) -> None:
        """Draw a value of a result with two combined uncertainties."""
        value, half_length = self.factor * estimate["value"], 2 * self.factor * estimate["combined"]
        self.axis.errorbar(time, value, half_length, fmt=".", color=colour, capsize=1.5, linewidth=0.8)
        self.bars.append((value, half_length))

    def set_limits(self, settled_from: float) -> None:
        """Limit the y axis to the later parts of the curves, and to the bars of the values in these limits."""
        limits = common_limits(self.settled, settled_from)
        if limits is None:
            return
        bounds = list(limits)
        for value, half_length in self.bars:
            if limits[0] <= value <= limits[1]:
                bounds += [value - _BAR_ROOM * half_length, value + _BAR_ROOM * half_length]
        self.axis.set_ylim(min(bounds), max(bounds))


def _draw_estimates(axis: Any, subject: Subject, names: Sequence[str], parameter: str) -> dict[str, Floats]:
    """Draw a parameter of tracks over time, and return the points by column [SI].

    `subject` is a run; its document is that of ``result.json``, which may have values of the tracks, and the truth.
    """
    document = subject.record.document
    symbol, factor = display_unit(subject.record.unit(names[0], parameter))
    panel = _Panel(axis, parameter, factor)
    data: dict[str, Floats] = {}
    for name in names:
        estimate = document.get("tracks", {}).get(name, {}).get("parameters", {}).get(parameter)
        data |= panel.draw_curve(subject.curves(name), estimate)
    truth = document.get("truth", {}).get(parameter)
    if truth is not None:
        axis.axhline(factor * truth, color="black", linewidth=0.6, linestyle=":", label="truth")
    axis.set(xlabel="time [s]", ylabel=f"{parameter.replace('_', ' ')} [{symbol}]")
    is_sweep = swept(subject.curves(names[0]).place)
    panel.set_limits(_SETTLED_FROM_SWEPT if is_sweep else _SETTLED_FROM)
    return data


def _shared_legends(axes: Sequence[Any]) -> None:
    """Draw a legend if the curves are others than in the panel before."""
    before: list[str] = []
    for axis in axes:
        labels = axis.get_legend_handles_labels()[1]
        if labels != before:
            legend_outside(axis, 2)
        before = labels
