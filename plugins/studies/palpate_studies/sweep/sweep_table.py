"""One table of all combinations, a row for each track."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from palpate import Flag, PalpateError
from palpate_engine import display_unit, verdict_rank, whole_file, write_whole
from palpate_kit.jobs.job import Outcome
from palpate_kit.terminal.result_screen import filled, finding_lines, with_legend
from palpate_kit.terminal.result_table import ResultFinding, ResultRow, ResultTable, TableValue
from palpate_kit.terminal.table import Table

from palpate_studies.sweep.combinations import Combination

_MAX_VALUES = 2  # of a track that are shown, a choice: elasticity and viscosity
_MAX_BEST = 12  # rows, a choice: half a screen
_ENDS = ("low", "high")  # of a value along a path


@dataclass(frozen=True)
class SweepRow:
    """The rows of a combination in the table of a sweep, and its run folder."""

    rows: list[dict[str, Any]]
    folder: Path | None  # of the run; None of a combination that failed
    failure: str | None  # the reason

    @classmethod
    def of(cls, combination: Combination, outcome: Outcome) -> SweepRow:
        """Return the rows of a combination by the outcome of its job."""
        rows = rows_of(combination, outcome)
        if isinstance(outcome, PalpateError):
            return cls(rows, None, str(outcome))
        return cls(rows, outcome.result.folder, None)


def rows_of(combination: Combination, outcome: Outcome) -> list[dict[str, Any]]:
    """Return a row for each track of a combination; of one that failed, a row with the reason."""
    settings = {"combination": combination.number, **combination.values}
    if isinstance(outcome, PalpateError):
        return [{**settings, "error": str(outcome)}]
    rows: list[dict[str, Any]] = []
    result = outcome.result.table()
    for name, track in result["tracks"].items():
        row = {**settings, "track": name}
        for parameter, estimate in {**track["parameters"], "surface": track["surface"]}.items():
            row |= _estimate_cells(parameter, estimate)
        row |= {f"{parameter}_truth": truth for parameter, truth in result["truth"].items()}
        rows.append(row | {key: track[key] for key in ("force_rms", "nis", "verdict", "flags")})
    return rows


def _estimate_cells(parameter: str, estimate: Mapping[str, Any]) -> dict[str, Any]:
    """Return the cells of a parameter by column: value [SI], uncertainties, verdict, and ends along a path."""
    cells = {f"{parameter} [{estimate['unit']}]": estimate["value"], f"{parameter}_std": estimate["std"]}
    if "verdict" in estimate:
        cells[f"{parameter}_verdict"] = estimate["verdict"]
    if "places" in estimate:
        cells |= {f"{parameter}_{end}": estimate["places"][end] for end in _ENDS}
    for key in ("systematic", "systematic_places", "combined"):
        if key in estimate:
            cells[f"{parameter}_{key}"] = estimate[key]
    return cells


def best_rows(rows: Sequence[dict[str, Any]]) -> Table:
    """Return the combinations with the smallest uncertainty of their first parameter, those that can be used first."""
    best = sorted((row for row in rows if "error" not in row), key=_cost)[:_MAX_BEST]
    # The columns: swept settings, the track if there are several, and the values.
    settings = [key for key in (best[0] if best else {}) if "." in key]  # a setting has the name of its table
    names = [_short_setting(key, settings) for key in settings]
    units = _shown_units(best)
    has_tracks = len({row["track"] for row in best}) > 1
    cells: list[list[str]] = []
    for row in best:
        row_cells = [str(row["combination"]), *(str(row[key]) for key in settings)]
        if has_tracks:
            row_cells.append(row["track"])
        for name, unit in units.items():
            row_cells += _number_and_verdict(row, name, unit)
        cells.append(row_cells)
    # The heads, in the order of the cells.
    headings = ["", *names]
    if has_tracks:
        headings.append("track")
    for name, unit in units.items():
        headings += [f"{name}\n{display_unit(unit)[0]}", f"{name}\nverdict"]
    title = f"best of {len(rows)} rows, by the uncertainty of {next(iter(units), 'nothing')}"
    text_headings = [*names, "track", *(f"{name}\nverdict" for name in units)]
    return Table.of(with_legend(title), headings, cells, text_headings)


def _cost(row: dict[str, Any]) -> tuple[int, float]:
    """Return the order of a row: the rank of its verdict, then the relative uncertainty of its first parameter."""
    shares: list[float] = []
    for name, unit in list(_shown_units([row]).items())[:1]:
        value = _table_value(row, name, unit)
        if value.value:
            shares.append(abs(value.of_one_place / value.value))
    return verdict_rank(row.get("verdict", "invalid")), min(filter(math.isfinite, shares), default=math.inf)


def _shown_units(rows: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """Return the SI units of the values that are shown, by name: the first two parameters of the rows.

    The column of a value is "NAME [UNIT]".
    """
    columns = dict.fromkeys(key for row in rows for key in row if key.endswith("]") and not key.startswith("surface"))
    units: dict[str, str] = {}
    for column in list(columns)[:_MAX_VALUES]:
        name, _, unit = column.rstrip("]").partition(" [")
        units[name] = unit
    return units


def sweep_doubt_lines(rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Yield each finding, once for all combinations that share it, and the numbers of rows with each verdict."""
    table = ResultTable(tuple(map(_result_row, rows)), thing="row")
    yield from finding_lines(table)
    yield from filled(table.partition(), "  ")


def _result_row(row: Mapping[str, Any]) -> ResultRow:
    """Return a row of a sweep as one of the table of results."""
    combination = f"{row['combination']}"
    if "error" in row:
        return ResultRow(combination, "", error=str(row["error"]))
    values = {name: _table_value(row, name, unit) for name, unit in _shown_units([row]).items()}
    numbers = {name: value.value for name, value in values.items()}
    flags = (Flag.of_table(flag) for flag in row.get("flags", ()))
    findings = tuple(ResultFinding.of_flag(flag, numbers) for flag in flags)
    return ResultRow(combination, str(row["track"]), values, findings=findings)


def _table_value(row: Mapping[str, Any], name: str, unit: str) -> TableValue:
    """Return a value of a row, with its range and spread along a path if there is one."""
    value, combined = row.get(f"{name} [{unit}]"), row.get(f"{name}_combined")
    verdict = row.get(f"{name}_verdict") or row.get("verdict", "")
    keys = {**{end: f"{name}_{end}" for end in _ENDS}, "spread": f"{name}_systematic_places"}
    has_path = keys["low"] in row
    places = {place: row[key] for place, key in keys.items()} if has_path else {}
    return TableValue(name, value, math.nan if combined is None else combined, unit, verdict, places)


def _short_setting(setting: str, settings: Sequence[str]) -> str:
    """Return the last word of a dotted setting; all of it if another one of the settings ends alike."""
    last_words = [other.rpartition(".")[2] for other in settings]
    last_word = setting.rpartition(".")[2]
    return last_word if last_words.count(last_word) == 1 else setting


def _number_and_verdict(row: dict[str, Any], name: str, unit: str) -> tuple[str, str]:
    """Return the cells of a value: the number with its uncertainty, and the verdict."""
    value = _table_value(row, name, unit)
    return "\n".join(value.number_lines), value.word


def write_rows(folder: Path, rows: Sequence[dict[str, Any]]) -> None:
    """Write ``sweep.csv`` and ``sweep.json``; raises OutputError."""
    columns = list(dict.fromkeys(column for row in rows for column in row if column not in ("flags", "error")))
    columns += ["flags", "error"]
    with whole_file(folder / "sweep.csv") as file:
        table = csv.DictWriter(file, columns, restval="", lineterminator="\n")
        table.writeheader()
        table.writerows({**row, "flags": _flag_texts(row)} for row in rows)
    write_whole(folder / "sweep.json", json.dumps(rows, indent=2, allow_nan=False) + "\n")


def _flag_texts(row: dict[str, Any]) -> str:
    """Return the flags of a row as "CODE: MESSAGE; ..."."""
    return "; ".join(f"{flag['code']}: {flag['message']}" for flag in row.get("flags", []))
