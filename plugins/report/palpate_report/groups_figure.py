"""The picture of groups of curves: the mean of each unit over mean and interval of its group."""

from __future__ import annotations

import csv
import io
import math
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
from palpate_kit.numerics.unit_group import UnitGroup

from palpate_report.number_texts import readable

_MAX_VECTOR_POINTS = 2000  # of a vector figure, a choice: more of them are drawn as pixels
_MAX_HEIGHT, _HEIGHT_SHARE = 80.0, 0.7  # [mm] of the figure, and of its width: choices
_SIDE = 0.6  # of the axis beyond the first and the last group, the distance of groups being 1: a choice
_HALF_WIDTH = 0.3  # of a group, the distance of groups being 1: a choice
_MARK_SPREAD = 0.8  # of the marks of a group to each side, of that half width: a choice
_LETTER_WIDTH = 1.5  # [mm] of a label, in the style's font
_AXIS_SHARE = 0.85  # of the width of the figure: the labels of the y axis take the rest
_MARK_SIZES = ((12, 4.5), (60, 3.0))  # [pt] up to so many units in a group; choices, marks hardly overlap
_SMALL_MARK = 1.6  # [pt] of groups with more units


@dataclass(frozen=True)
class GroupsFigure:
    """A figure of groups, what it shows in one sentence, and its numbers as CSV."""

    figure: Any
    caption: str
    data: str


def folder_comparison(
    path: Path, by: str | None, parameter: str, unit: str | None, where: str | None, track: str | None
) -> GroupComparison:
    """Return the comparison of groups of curves in a folder of fits, by a parameter of one track.

    `by` is the column of the groups, `unit` that of the units of replication, `where` has filter words. Raises
    UserError for an unknown name, or without a value.
    """
    folder = FitFolder(path)
    choices = {"--by": folder.columns, "--track": folder.tracks, "--parameter": folder.values}
    for option, name in (("--by", by), ("--track", track), ("--parameter", parameter)):
        if name is not None and name not in choices[option]:
            raise ConfigurationError(f"{option} {name}: {path} has no such{suggest(name, choices[option])}")
    # Curves of one track are compared; rows of a folder without tracks have an empty name.
    if track is None and len(folder.tracks) > 1:
        raise ConfigurationError(f"{path}: has {len(folder.tracks)} tracks; choose one with --track")
    chosen_track = track or next(iter(folder.tracks), "")
    rows = curve_filter(where, folder, registry.load().meanings).choose(folder.rows)
    rows_of_track = (row for row in rows if row.track in (chosen_track, ""))
    comparison = compare_rows(rows_of_track, parameter, by, unit)
    if not comparison.groups:
        raise LogError(f"{path}: no curve has a value of {parameter}" + (f" where {where!r}" if where else ""))
    return comparison


@style()
def groups_figure(comparison: GroupComparison, parameter: str, unit: str, width: float) -> GroupsFigure:
    """Return the figure of a comparison of a parameter with an SI unit, of a width [mm]; it reads in grey."""
    quantity = readable(parameter)
    symbol, factor = display_unit(unit)
    figure, axes = figure_of(width=width, height=min(_HEIGHT_SHARE * width, _MAX_HEIGHT))
    axis = axes[0, 0]
    max_units = max(group.units for group in comparison.groups)
    mark_size = next((size for units, size in _MARK_SIZES if max_units <= units), _SMALL_MARK)
    for position, group in enumerate(comparison.groups):
        _draw_group(axis, position, group, factor, mark_size)
    _label_groups(axis, [f"{group.name}\nn = {group.units}" for group in comparison.groups], width)
    axis.grid(visible=False, axis="x")
    axis.set(
        xlim=(-_SIDE, len(comparison.groups) - 1 + _SIDE),
        ylabel=f"{quantity} [{symbol}]" if symbol else quantity,
    )
    points = "Values of single curves" if comparison.singles else f"Means of units ({comparison.unit})"
    caption = f"{points} over the mean of their group and its 95 % interval. {comparison.sentence}".strip()
    return GroupsFigure(figure, caption, _csv(comparison, parameter, unit))


def _draw_group(axis: Any, position: int, group: UnitGroup, factor: float, mark_size: float) -> None:
    """Draw a group about a position on the x axis: a bar for the interval, a line for the mean, a mark for each unit.

    `factor` is how many of the figure's unit one SI unit is; `mark_size` and widths of lines are in points, greys from
    0 (black) to 1.
    """
    sides = (position - _HALF_WIDTH, position + _HALF_WIDTH)
    low, high = (factor * bound for bound in group.interval)
    if np.isfinite(low):  # one unit has no interval
        axis.fill_between(sides, low, high, color="0.82", linewidth=0)
    axis.hlines(factor * group.mean, *sides, color="black", linewidth=1.2)
    # Marks side by side in the order of the units, so that equal values do not hide each other.
    offsets = np.zeros(1)
    if group.units > 1:
        offsets = np.linspace(-_MARK_SPREAD, _MARK_SPREAD, group.units) * _HALF_WIDTH
    axis.plot(
        position + offsets, factor * group.means, "o", markersize=mark_size, markerfacecolor="0.35",
        markeredgecolor="white", markeredgewidth=0.4, linestyle="none", rasterized=group.units > _MAX_VECTOR_POINTS,
    )  # fmt: skip


def _label_groups(axis: Any, labels: list[str], width: float) -> None:
    """Label the groups of a figure of a width [mm], upright where a line of a label is wider than its group."""
    max_letters = max(len(line) for label in labels for line in label.splitlines())
    is_upright = _LETTER_WIDTH * max_letters > _AXIS_SHARE * width / len(labels)
    axis.set_xticks(range(len(labels)), labels, **({"rotation": 90} if is_upright else {}))


def _csv(comparison: GroupComparison, parameter: str, unit: str) -> str:
    """Return a row for each unit [SI], with mean and interval of its group; an unknown number is an empty cell."""
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    unit_suffix = f" [{unit}]" if unit else ""
    names = (parameter, "mean of group", "low of 95 %", "high of 95 %")
    writer.writerow(["group", comparison.unit, "curves", *(f"{name}{unit_suffix}" for name in names)])
    for group in comparison.groups:
        for (name, values), mean in zip(group.values.items(), group.means.tolist(), strict=True):
            numbers = (mean, group.mean, *group.interval)
            cells = ["" if math.isnan(number) else f"{number:.9g}" for number in numbers]
            writer.writerow([group.name, name, len(values), *cells])
    return file.getvalue()
