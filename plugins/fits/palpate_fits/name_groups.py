"""Groups of files by a pattern of their names, as columns of ``curves.csv``."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from palpate import ConfigurationError
from palpate_engine import Pipeline, display_unit
from palpate_kit.curves.alike_logs import LogPart
from palpate_kit.curves.curve_fits import Row, value_units
from palpate_kit.curves.curve_list import OWN, Entries, columns_of
from palpate_kit.curves.row_summary import summary_of
from palpate_kit.terminal.table import Table

from palpate_fits.quartile_table import quartiles_text

GROUP = "group"
_MAX_GROUPS = 24  # rows of a table, about a screen (choice); later ones by name are counted in a last row


def name_pattern(text: str) -> re.Pattern[str]:
    """Return the pattern of ``--by``; raises ConfigurationError where it is not a pattern, or has no group in
    brackets."""
    try:
        pattern = re.compile(text)
    except re.error as error:
        raise ConfigurationError(f"--by {text!r}: is not a pattern of names: {error}") from error
    if not pattern.groups:
        brackets = 'has no group in brackets, as in --by "(ctrl|treat)"'
        raise ConfigurationError(f"--by {text!r}: {brackets}, and curves.csv has no such column")
    if wrong := next((name for name in pattern.groupindex if name in OWN), None):
        raise ConfigurationError(f"--by {text!r}: a group cannot be called {wrong!r}, as a column of curves.csv is")
    return pattern


def groups_of(files: Sequence[LogPart], sources: Sequence[Path], by: str | None, cells: Entries) -> Entries:
    """Return the groups of each file: by a column of ``curves.csv`` next to the files, else by a pattern of names.

    Raises ConfigurationError.
    """
    if by is None:
        return {}
    if by in columns_of(cells.values()):
        return {name: {by: of_curve[by]} for name, of_curve in cells.items() if by in of_curve}
    return groups_by_name(files, sources, name_pattern(by))


def groups_by_name(files: Sequence[LogPart], sources: Sequence[Path], pattern: re.Pattern[str]) -> Entries:
    """Return the groups of each file whose name, as seen from the folder that was given, has the pattern.

    The columns are the named groups of the pattern, or are numbered. Raises ConfigurationError where no file has it.
    """
    names = {number: name for name, number in pattern.groupindex.items()}
    columns = [names.get(k, GROUP if k == 1 else f"{GROUP}{k}") for k in range(1, pattern.groups + 1)]
    groups: Entries = {}
    for file in files:
        match = pattern.search(_name(file, sources))
        if match is not None:
            groups[str(file)] = dict(zip(columns, (text or "" for text in match.groups()), strict=True))
    if not groups:
        raise ConfigurationError(f"--by {pattern.pattern!r}: no name has it, such as {_name(files[0], sources)!r}")
    return groups


def _name(file: LogPart, sources: Sequence[Path]) -> str:
    """Return a file as seen from the folder that was given, with its record."""
    folder = next((source for source in sources if source in file.path.parents), file.path.parent)
    return str(LogPart(file.path.relative_to(folder), file.part))


def group_table(rows: Sequence[Row], groups: Mapping[str, Mapping[str, str]], pipeline: Pipeline) -> Table:
    """Return the table of groups: how many curves each has, and median and quartiles of their values.

    `groups` has the labels of each curve by column, as in ``{"S1_07": {"animal": "3", "side": "left"}}``; a group is of
    the curves that have all labels in common, and is called by them. Values are those of the first track.
    """
    rows_by_group: dict[str, list[Row]] = {}
    for row in rows:
        labels = groups.get(row["curve"], {}).values()
        group_name = " ".join(labels).strip() or "none"
        rows_by_group.setdefault(group_name, []).append(row)
    units = value_units(pipeline.tracks[0].model)
    names = [name for name in units if any(row.get(name) for row in rows)]
    cells = []
    for group_name, group_rows in sorted(rows_by_group.items())[:_MAX_GROUPS]:
        # A row without a track has no values.
        summary_by_track = summary_of([row for row in group_rows if row.get("track")], names)
        first_summary = next(iter(summary_by_track.values()), {})
        quartiles = first_summary.get("quartiles", {})
        texts = [quartiles_text(quartiles.get(name), display_unit(units[name])[1]) for name in names]
        curve_count = len({row["curve"] for row in group_rows})
        cells.append([group_name, str(curve_count), *texts])
    if (further_count := len(rows_by_group) - _MAX_GROUPS) > 0:
        cells.append([f"and {further_count} more", *("" for _ in range(len(names) + 1))])
    headings = [f"{name}\n{display_unit(units[name])[0]}" for name in names]
    return Table.of("median (quartiles) of the groups", [GROUP, "curves", *headings], cells, [GROUP])
