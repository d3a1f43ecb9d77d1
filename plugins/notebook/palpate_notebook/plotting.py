"""Pictures of runs and records."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from palpate import ConfigurationError, Floats, Samples, suggest
from palpate_engine import display_unit
from palpate_kit.figures import common_limits, figure_of, label_forces, legend_outside, style

from palpate_notebook.figure_object import Picture
from palpate_notebook.run_data import RunData

_MOST = 20_000  # points in a curve
_PANELS = 2  # side by side


class Plots:
    """The pictures of a run."""

    def __init__(self, run: RunData) -> None:
        self._run = run

    def __call__(self, *parameters: str) -> Picture:
        """Parameters over time, a panel each: every track with a band of two standard deviations, and the truth."""
        known = _parameters(self._run)
        for name in parameters:
            if name not in known:
                raise ConfigurationError(f"no track has {name!r}{suggest(name, known)}")
        return Picture(_over_time(self._run, list(parameters) or list(known), known))

    def force_depth(self, *tracks: str) -> Picture:
        """Measured and modelled force over depth, a panel for each track."""
        names = [self._run[name].name for name in tracks] or _usable(self._run)
        return Picture(_panels(self._run, names, over_depth=True))

    def force(self, *tracks: str) -> Picture:
        """Measured and modelled force over time, a panel for each track."""
        names = [self._run[name].name for name in tracks] or _usable(self._run)
        return Picture(_panels(self._run, names, over_depth=False))


def _usable(run: RunData) -> list[str]:
    return [name for name, track in run.tracks.items() if track.verdict != "invalid"] or list(run.tracks)


def _parameters(run: RunData) -> dict[str, str]:
    """SI unit by parameter, of all tracks."""
    tracks = run.document["tracks"].values()
    return {name: found["unit"] for track in tracks for name, found in track["parameters"].items()}


def _grid(count: int, height: float = 55.0) -> tuple[Any, list[Any]]:
    columns = min(count, _PANELS)
    figure, axes = figure_of(max(columns, 1), max(-(-count // _PANELS), 1), height=height)
    flat = list(axes.ravel())
    for axis in flat[count:]:
        axis.set_axis_off()
    return figure, flat[:count]


@style()
def _over_time(run: RunData, parameters: list[str], units: dict[str, str]) -> Any:
    figure, axes = _grid(len(parameters))
    for axis, name in zip(axes, parameters, strict=True):
        word, factor = display_unit(units[name])
        settled: list[Floats] = []
        for track in _usable(run):
            table = run.track_tables.get(track)
            if table is None or name not in table.values:
                continue
            rows = _thinned(np.flatnonzero(table.usable & np.isfinite(table.values[name])))
            time, value, std = table.time[rows], factor * table.values[name][rows], factor * table.std[name][rows]
            (line,) = axis.plot(time, value, label=track)
            axis.fill_between(time, value - 2 * std, value + 2 * std, color=line.get_color(), alpha=0.15, linewidth=0)
            settled.append(value)
        if name in run.truth:
            axis.axhline(factor * run.truth[name], color="black", linestyle=":", linewidth=0.8, label="truth")
        axis.set_ylim(common_limits(settled))
        axis.set(xlabel="time [s]", ylabel=f"{name} [{word}]")
        legend_outside(axis)
    return figure


@style()
def _panels(run: RunData, names: list[str], over_depth: bool) -> Any:
    samples = run.aligned
    figure, axes = _grid(len(names))
    for axis, name in zip(axes, names, strict=True):
        table = run.track_tables[name]
        rows = _thinned(np.flatnonzero(table.usable & np.isfinite(table.others["force"])))
        measured = np.interp(table.time[rows], samples.time, run.contact_force)
        position = np.interp(table.time[rows], samples.time, samples.position)
        along = 1e3 * (table.others["surface"][rows] - position) if over_depth else table.time[rows]
        axis.plot(along, measured, ".", markersize=1, color="0.6", label="measured")
        axis.set_prop_cycle(None)
        axis.plot(along, table.others["force"][rows], linewidth=0.8, label=name)
        axis.set(xlabel="depth [mm]" if over_depth else "time [s]", ylabel="contact force [N]")
        legend_outside(axis)
    return figure


@style()
def samples_picture(samples: Samples, title: str) -> Picture:
    """Force, height and velocity over time."""
    figure, axes = figure_of(1, 3, height=35.0)
    rows = _thinned(np.arange(len(samples)))
    for axis, (column, label) in zip(axes[:, 0], _columns(samples), strict=True):
        axis.plot(samples.time[rows], column[rows], linewidth=0.8)
        axis.set_ylabel(label)
    axes[0, 0].set_title(title)
    axes[-1, 0].set_xlabel("time [s]")
    return Picture(figure)


def _columns(samples: Samples) -> Iterator[tuple[Floats, str]]:
    yield samples.force, "force [N]"
    yield 1e3 * samples.position, "height [mm]"
    yield 1e3 * samples.velocity, "velocity [mm/s]"


def _thinned(rows: Any) -> Any:
    return rows[:: max(len(rows) // _MOST, 1)]


@style()
def fit_picture(run: RunData, name: str) -> Picture:
    """Measured and modelled force over time and over depth, and the residual over time."""
    samples, table = run.aligned, run.track_tables[name]
    figure, axes = figure_of(3)
    rows = _thinned(np.flatnonzero(table.usable & np.isfinite(table.others["force"])))
    time, modelled = table.time[rows], table.others["force"][rows]
    measured = np.interp(time, samples.time, run.contact_force)
    depth = 1e3 * (table.others["surface"][rows] - np.interp(time, samples.time, samples.position))
    for axis, along, label in ((axes[0, 0], time, "time [s]"), (axes[0, 1], depth, "depth [mm]")):
        axis.plot(along, measured, ".", markersize=1, color="0.6", label="measured")
        axis.set_prop_cycle(None)
        axis.plot(along, modelled, linewidth=0.8, label=name)
        axis.set(xlabel=label, ylabel="contact force [N]")
    axes[0, 2].plot(time, measured - modelled, ".", markersize=1, label="measured less model")
    axes[0, 2].set(xlabel="time [s]")
    label_forces(axes[0, 2], "residual")
    for axis in axes[0]:
        legend_outside(axis)
    return Picture(figure)
