"""The picture of groups of curves: the mean of each unit over mean and interval of its group."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from palpate import ConfigurationError, LogError, suggest
from palpate_engine import display_unit, registry
from palpate_kit.curves.curve_filter import curve_filter
from palpate_kit.curves.fit_folder import FitFolder
from palpate_kit.curves.replication_unit import compare_rows
from palpate_kit.figures import figure_of, style
from palpate_kit.numerics.group_comparison import GroupComparison

from palpate_report.number_texts import readable

_MAX_VECTOR_POINTS = 2000  # of a vector figure, a choice: more of them are drawn as pixels
_HALF_WIDTH = 0.3  # of a group, the distance of groups being 1: a choice
_LETTER_WIDTH = 1.5  # [mm] of a label, in the style's font


@dataclass(frozen=True)
class GroupsFigure:
    """A figure of groups, what it shows in one sentence, and its numbers as CSV."""

    figure: Any
    caption: str
    data: str


def folder_comparison(
    path: Path, by: str | None, parameter: str, unit: str | None, where: str | None, track: str | None
) -> GroupComparison:
    """Return the comparison of groups of a folder of fits; raises UserError for anything else."""
    folder = FitFolder(path)
    choices = {"--by": folder.columns, "--track": folder.tracks, "--parameter": folder.values}
    for option, name in (("--by", by), ("--track", track), ("--parameter", parameter)):
        if name is not None and name not in choices[option]:
            raise ConfigurationError(f"{option} {name}: {path} has no such{suggest(name, choices[option])}")
    if track is None and len(folder.tracks) > 1:
        raise ConfigurationError(f"{path}: has {len(folder.tracks)} tracks; choose one with --track")
    chosen = track or next(iter(folder.tracks), "")
    rows = curve_filter(where, folder, registry.load().meanings).choose(folder.rows)
    comparison = compare_rows((row for row in rows if row.track in (chosen, "")), parameter, by, unit)
    if not comparison.groups:
        raise LogError(f"{path}: no curve has a value of {parameter}" + (f" where {where!r}" if where else ""))
    return comparison


@style()
def groups_figure(comparison: GroupComparison, parameter: str, unit: str, width: float) -> GroupsFigure:
    """Return the figure of a comparison of a parameter with an SI unit, of a width [mm]; it reads in grey."""
    quantity = readable(parameter)
    symbol, factor = display_unit(unit)
    figure, axes = figure_of(width=width, height=min(0.7 * width, 80.0))
    axis = axes[0, 0]
    max_units = max(group.units for group in comparison.groups)
    size = 4.5 if max_units <= 12 else 3.0 if max_units <= 60 else 1.6
    for place, group in enumerate(comparison.groups):
        sides = (place - _HALF_WIDTH, place + _HALF_WIDTH)
        low, high = (factor * end for end in group.interval)
        if np.isfinite(low):
            axis.fill_between(sides, low, high, color="0.82", linewidth=0)
        axis.hlines(factor * group.mean, *sides, color="black", linewidth=1.2)
        apart = np.linspace(-0.8, 0.8, group.units) * _HALF_WIDTH if group.units > 1 else np.zeros(1)
        axis.plot(
            place + apart, factor * group.means, "o", markersize=size, markerfacecolor="0.35", markeredgecolor="white",
            markeredgewidth=0.4, linestyle="none", rasterized=group.units > _MAX_VECTOR_POINTS,
        )  # fmt: skip
    labels = [f"{group.name}\nn = {group.units}" for group in comparison.groups]
    room = 0.85 * width / len(labels)
    turned = _LETTER_WIDTH * max(len(line) for label in labels for line in label.splitlines()) > room
    axis.set_xticks(range(len(labels)), labels, **({"rotation": 90} if turned else {}))
    axis.grid(visible=False, axis="x")
    axis.set(xlim=(-0.6, len(labels) - 0.4), ylabel=f"{quantity} [{symbol}]" if symbol else quantity)
    points = "Values of single curves" if comparison.singles else f"Means of units ({comparison.unit})"
    caption = f"{points} over the mean of their group and its 95 % interval. {comparison.sentence}".strip()
    return GroupsFigure(figure, caption, _csv(comparison, parameter, unit))


def _csv(comparison: GroupComparison, parameter: str, unit: str) -> str:
    """Return a row for each unit [SI], with mean and interval of its group."""
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    end = f" [{unit}]" if unit else ""
    names = (parameter, "mean of group", "low of 95 %", "high of 95 %")
    writer.writerow(["group", comparison.unit, "curves", *(f"{name}{end}" for name in names)])
    for group in comparison.groups:
        numbers = (group.mean, *group.interval)
        for (name, values), mean in zip(group.values.items(), group.means.tolist(), strict=True):
            cells = ["" if number != number else f"{number:.9g}" for number in (mean, *numbers)]
            writer.writerow([group.name, name, len(values), *cells])
    return file.getvalue()
