"""Every picture of a run, in one style, each with the numbers that it is drawn from."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from palpate import Floats
from palpate.host import WIDTHS, common_limits, figure_of, legend_outside, people, quartiles, style

from palpate_report.curves import Curves, along, curves_of, moving, swept, thinned
from palpate_report.grid import grid_of
from palpate_report.reading import Record

_MOST = 800  # points of a curve
_TRACKS = 7  # of one panel: as many as the style has colours
_PANELS = 8
_CLOSE = 4.0  # [s] of a long record that are drawn of the force over time
_GREY = "0.6"
_NARROW = 100.0  # [mm] of a picture whose panels stand one above the other
_QUARTILE = 0.6745  # standard deviations, within which half of a normal distribution lies


@dataclass(frozen=True)
class Picture:
    """A figure, what it shows in one sentence, and its numbers by column [SI]; columns may differ in length."""

    figure: Any
    caption: str
    data: Mapping[str, Floats]


@dataclass(frozen=True)
class Subject:
    """What is drawn: a run, the track that is shown where there is room for one, and all that are worth it."""

    record: Record
    main: str | None
    tracks: Sequence[str]  # the main one first
    width: float = WIDTHS["double"]  # [mm]
    _known: dict[str, Curves] = field(default_factory=dict)

    def curves(self, name: str) -> Curves:
        """The curves of one track."""
        if name not in self._known:
            self._known[name] = curves_of(self.record, name)
        return self._known[name]


def force_depth(subject: Subject) -> Picture | None:
    """Contact force over depth, measured and by the model of the main track, and both over time."""
    if subject.main is None:
        return None
    curves = subject.curves(subject.main)
    rows = np.flatnonzero(curves.settled & np.isfinite(curves.force) & np.isfinite(curves.depth))
    if len(rows) < 2:
        return None
    rows = rows[curves.time[rows] >= curves.time[rows][-1] - _long(curves)]
    rows = rows[thinned(len(rows), _MOST)]
    depth, force, model = 1e3 * curves.depth[rows], curves.force[rows], curves.model[rows]
    figure, axes = figure_of(width=subject.width, height=65.0)
    axis = axes[0, 0]
    axis.plot(depth, force, ".", markersize=1.5, color=_GREY, label="measured")
    axis.set_prop_cycle(None)
    axis.plot(depth, model, linewidth=0.7, label=subject.main)
    axis.set(xlabel="depth [mm]", ylabel="contact force [N]")
    axis.set_ylim(_around(force))
    legend_outside(axis)
    caption = f"Contact force over depth: measured less the inertia of the tip, and the model of {subject.main}"
    return Picture(figure, caption, {"depth_m": depth / 1e3, "force_N": force, f"{subject.main}:force_N": model})


def _long(curves: Curves) -> float:
    """How much of the end is drawn [s]: everything of a point, the last seconds of a sweep, whose material changes."""
    return _CLOSE if swept(curves.place) else np.inf


def over_time(subject: Subject) -> Picture | None:
    """Contact force over time, measured and by the models."""
    if subject.main is None:
        return None
    main = subject.curves(subject.main)
    rows = np.flatnonzero(np.isfinite(main.force))
    if len(rows) < 2:
        return None
    long = float(np.ptp(main.time[rows])) > 10 * _CLOSE
    if long:
        end = float(main.time[np.flatnonzero(main.used)[-1]]) if main.used.any() else float(main.time[rows][-1])
        rows = rows[(main.time[rows] <= end) & (main.time[rows] >= end - _CLOSE)]
    rows = rows[thinned(len(rows), _MOST)]
    figure, axes = figure_of(width=subject.width, height=50.0)
    axis = axes[0, 0]
    axis.plot(main.time[rows], main.force[rows], ".", markersize=1.5, color=_GREY, label="measured")
    axis.set_prop_cycle(None)
    data = {"time_s": main.time[rows], "force_N": main.force[rows]}
    for name in subject.tracks[:3]:
        curves = subject.curves(name)
        if not curves.used.any():
            continue
        model = np.where(curves.used, curves.model, np.nan)
        shown = np.interp(main.time[rows], curves.time, model)
        axis.plot(main.time[rows], shown, linewidth=0.8, label=name)
        data[f"{name}:force_N"] = shown
    axis.set(xlabel="time [s]", ylabel="contact force [N]")
    axis.set_ylim(_around(main.force[rows]))
    legend_outside(axis, 4)
    caption = f"Contact force over time{f', the last {_CLOSE:g} s of contact' if long else ''}"
    return Picture(figure, caption, data)


def _beside(subject: Subject, panels: int) -> int:
    """How many panels there is room for beside each other."""
    return min(panels, 2 if subject.width > _NARROW else 1)


def _pair(subject: Subject, panels: int) -> tuple[Any, list[Any]]:
    """A figure with one or two panels, beside each other where there is room."""
    columns = _beside(subject, panels)
    figure, axes = figure_of(columns, -(-panels // columns), width=subject.width, height=52.0)
    return figure, list(axes.ravel())


def residuals(subject: Subject) -> Picture | None:
    """Measured less model over time and over depth, by medians and quartiles."""
    names = [
        name
        for name in subject.tracks
        if np.isfinite(subject.curves(name).residual[subject.curves(name).settled]).any()
    ]
    if not names:
        return None
    figure, axes = _pair(subject, 2)
    data: dict[str, Floats] = {}
    for name in names[:3]:
        curves = subject.curves(name)
        rows = curves.settled
        for axis, across, scale, key in (
            (axes[0], curves.time, 1.0, "time_s"),
            (axes[1], curves.depth, 1e3, "depth_m"),
        ):
            x, (low, middle, high) = quartiles(across[rows], curves.residual[rows], 40 if scale == 1 else 20)
            (line,) = axis.plot(scale * x, middle, label=name)
            axis.fill_between(scale * x, low, high, color=line.get_color(), alpha=0.18, linewidth=0)
            data |= {f"{name}:{key}": x, f"{name}:residual_{key[0]}_N": middle, f"{name}:low_{key[0]}_N": low}
            data[f"{name}:high_{key[0]}_N"] = high
    for axis, word in zip(axes, ("time [s]", "depth [mm]"), strict=True):
        axis.axhline(0.0, color="black", linewidth=0.5, linestyle="-")
        axis.set(xlabel=word, ylabel="measured less model [N]")
    legend_outside(axes[0])
    caption = "What the model leaves of the force: medians, and the band that holds the middle half"
    return Picture(figure, caption, data)


def estimates(subject: Subject) -> Picture | None:
    """Every parameter over time with bands of two standard deviations, by model; the truth where it is known."""
    panels = [(names, parameter) for names, parameter in _panels(subject) if names][:_PANELS]
    if not panels:
        return None
    columns = _beside(subject, len(panels))
    figure, axes = figure_of(columns, -(-len(panels) // columns), width=subject.width, height=48.0)
    data: dict[str, Floats] = {}
    for axis, (names, parameter) in zip(axes.ravel(), panels, strict=False):
        _draw_estimates(axis, subject, names, parameter, data)
    for axis in axes.ravel()[len(panels) :]:
        axis.set_axis_off()
    _shared_legends(axes.ravel()[: len(panels)])
    caption = "Estimates over time with bands of two of the estimator's standard deviations; bars: two combined u"
    return Picture(figure, caption, data)


def _panels(subject: Subject) -> list[tuple[list[str], str]]:
    by_model: dict[tuple[str, str], list[str]] = {}
    for name in subject.tracks:
        for parameter in subject.curves(name).values if subject.curves(name).used.any() else ():
            by_model.setdefault((name.partition("/")[0], parameter), []).append(name)
    return [(names[:_TRACKS], parameter) for (_, parameter), names in by_model.items()]


def _draw_estimates(axis: Any, subject: Subject, names: Sequence[str], parameter: str, data: dict[str, Floats]) -> None:
    found = [
        subject.record.document.get("tracks", {}).get(name, {}).get("parameters", {}).get(parameter) for name in names
    ]
    word, factor = people(subject.record.unit(names[0], parameter))
    settled = list[Floats]()
    bars = list[tuple[float, float]]()
    for name, table in zip(names, found, strict=True):
        curves = subject.curves(name)
        used = np.flatnonzero(curves.used)
        rows = used[thinned(len(used), _MOST // 2)]
        if not len(rows):
            continue
        time, value, std = (
            curves.time[rows],
            factor * curves.values[parameter][rows],
            factor * curves.std[parameter][rows],
        )
        (line,) = axis.plot(time, value, label=name)
        axis.fill_between(time, value - 2 * std, value + 2 * std, color=line.get_color(), alpha=0.15, linewidth=0)
        settled.append(factor * curves.values[parameter][curves.settled])
        if table and table["value"] is not None and table.get("combined"):
            at, bar = time[-1] + (0.02 + 0.015 * len(bars)) * np.ptp(time), 2 * factor * table["combined"]
            axis.errorbar(at, factor * table["value"], bar, fmt=".", color=line.get_color(), capsize=1.5, linewidth=0.8)
            bars.append((factor * table["value"], bar))
        data |= {f"{name}:time_s": time, f"{name}:{parameter}": value / factor, f"{name}:{parameter}_std": std / factor}
    truth = subject.record.document.get("truth", {}).get(parameter)
    if truth is not None:
        axis.axhline(factor * truth, color="black", linewidth=0.6, linestyle=":", label="truth")
    axis.set(xlabel="time [s]", ylabel=f"{parameter.replace('_', ' ')} [{word}]")
    limits = common_limits(settled, 0.1 if swept(subject.curves(names[0]).place) else 0.5)
    if limits is not None:
        seen = [value + side * 1.1 * bar for value, bar in bars if limits[0] <= value <= limits[1] for side in (-1, 1)]
        axis.set_ylim(min(limits[0], *seen, limits[0]), max(limits[1], *seen, limits[1]))


def _shared_legends(axes: Sequence[Any]) -> None:
    """A legend only where the curves are others than in the panel before."""
    before: list[str] = []
    for axis in axes:
        labels = axis.get_legend_handles_labels()[1]
        if labels != before:
            legend_outside(axis, 2)
        before = labels


def innovations(subject: Subject) -> Picture | None:
    """Innovations over their standard deviations over time, and their autocorrelation."""
    tracks = subject.record.document.get("tracks", {})
    white = {
        name: tracks[name]["diagnoses"]["innovations"]
        for name in subject.tracks
        if "innovations" in tracks.get(name, {}).get("diagnoses", {})
    }
    names = [
        name
        for name in subject.tracks
        if np.isfinite(subject.curves(name).innovation[subject.curves(name).settled]).sum() > 50
    ]
    if not names:
        return None
    figure, axes = _pair(subject, 2 if white else 1)
    data: dict[str, Floats] = {}
    left = axes[0]
    for name in names[:3]:
        curves = subject.curves(name)
        x, (low, middle, high) = quartiles(curves.time[curves.settled], curves.innovation[curves.settled], 50)
        (line,) = left.plot(x, middle, label=name)
        left.fill_between(x, low, high, color=line.get_color(), alpha=0.18, linewidth=0)
        data |= {f"{name}:time_s": x, f"{name}:innovation": middle, f"{name}:low": low, f"{name}:high": high}
    for level in (-_QUARTILE, 0.0, _QUARTILE):
        left.axhline(level, color="black", linewidth=0.5, linestyle="-" if level == 0 else ":")
    left.set(xlabel="time [s]", ylabel="innovation / its std")
    for name, table in list(white.items())[:_TRACKS]:
        shares = np.array(table["autocorrelation"])
        lags = 1e3 * table["interval"] * np.arange(1, len(shares) + 1)
        axes[1].plot(lags, shares, marker=".", markersize=2, linewidth=0.7, label=name)
        data |= {f"{name}:lag_s": lags / 1e3, f"{name}:autocorrelation": shares}
    if white:
        bound = max(2 / np.sqrt(table["samples"]) for table in white.values())
        axes[1].axhspan(-bound, bound, color="0.85", linewidth=0)
        axes[1].set(xlabel="lag [ms]", ylabel="autocorrelation")
        axes[1].set_ylim(min(-0.2, *axes[1].get_ylim()), max(0.4, axes[1].get_ylim()[1]))
        legend_outside(axes[1])
    else:
        legend_outside(left)
    caption = (
        "Innovations: median and middle half (dotted: of white noise of the expected size); their "
        "autocorrelation over the later half of the record (grey: where 95 % of that of white noise lies)"
    )
    return Picture(figure, caption, data)


def way(subject: Subject) -> Picture | None:
    """The map of the main track: along a line, or over an area; lumps where `palpate lumps` has found some."""
    if subject.main is None or not swept(subject.curves(subject.main).place):
        return None
    main = subject.curves(subject.main)
    parameter = next(iter(main.values))
    word, factor = people(subject.record.unit(subject.main, parameter))
    label = f"{parameter.replace('_', ' ')} [{word}]"
    if along(main.place) is not None:
        return _line(subject, parameter, label, factor)
    return _area(subject, main, parameter, label, factor)


def _line(subject: Subject, parameter: str, label: str, factor: float) -> Picture:
    figure, axes = figure_of(width=subject.width, height=60.0)
    axis, settled, data = axes[0, 0], [], dict[str, Floats]()
    for name in [name for name in subject.tracks if parameter in subject.record.tracks[name][1].values][:_TRACKS]:
        curves = subject.curves(name)
        coordinate = along(curves.place)
        if coordinate is None:
            continue
        rows = np.flatnonzero(curves.settled & np.isfinite(coordinate))
        rows = rows[moving(curves.time[rows], coordinate[rows])]
        rows = rows[thinned(len(rows), _MOST // 2)]
        at, value, std = (
            1e3 * coordinate[rows],
            factor * curves.values[parameter][rows],
            factor * curves.std[parameter][rows],
        )
        (line,) = axis.plot(at, value, label=name)
        axis.fill_between(at, value - 2 * std, value + 2 * std, color=line.get_color(), alpha=0.15, linewidth=0)
        settled.append(value)
        data |= {
            f"{name}:along_m": at / 1e3,
            f"{name}:{parameter}": value / factor,
            f"{name}:{parameter}_std": std / factor,
        }
    axis.set(xlabel="along the way [mm]", ylabel=label)
    axis.set_ylim(common_limits(settled, 0.0))
    legend_outside(axis, 4)
    return Picture(figure, "Estimates along the way, with bands of two standard deviations by the estimator", data)


def _area(subject: Subject, main: Curves, parameter: str, label: str, factor: float) -> Picture:
    grid = grid_of(subject.record, main, parameter)
    figure, axes = figure_of(width=min(subject.width, WIDTHS["middle"]), height=75.0)
    axis = axes[0, 0]
    low, high = np.nanquantile(grid.value, [0.01, 0.99]) * factor
    extent = [1e3 * edge for edge in grid.extent]
    shown = axis.imshow(
        factor * grid.value, origin="lower", extent=extent, vmin=low, vmax=high, interpolation="nearest"
    )
    figure.colorbar(shown, ax=axis, shrink=0.8, label=label)
    axis.grid(False)
    for lump in lumps_of(subject.record):
        x, y = lump.get("highest") or (lump["x"], lump["y"])
        axis.plot(1e3 * x, 1e3 * y, "+", color="red", markersize=7, markeredgewidth=1.2)
    axis.set(xlabel="x [mm]", ylabel="y [mm]")
    x, y = np.meshgrid(grid.x, grid.y)
    return Picture(figure, grid.caption, {"x_m": x.ravel(), "y_m": y.ravel(), parameter: grid.value.ravel()})


def lumps_of(record: Record) -> list[dict[str, Any]]:
    """The lumps that `palpate lumps` has found in a run; none where it was not asked."""
    try:
        return list(json.loads((record.folder.maps / "lumps.json").read_text(encoding="utf-8"))["lumps"])
    except (OSError, ValueError, KeyError, TypeError):
        return []


def _around(values: Floats) -> tuple[float, float]:
    low, high = np.nanmin(values), np.nanmax(values)
    margin = 0.08 * (high - low) or 0.1
    return float(low - margin), float(high + margin)


PICTURES: dict[str, Callable[[Subject], Picture | None]] = {
    "force-depth": force_depth,
    "time": over_time,
    "residuals": residuals,
    "estimates": estimates,
    "innovations": innovations,
    "map": way,
}


@style()
def draw(name: str, subject: Subject) -> Picture | None:
    """A picture by its name, in palpate's style; None where the run has nothing to show for it."""
    return PICTURES[name](subject)
