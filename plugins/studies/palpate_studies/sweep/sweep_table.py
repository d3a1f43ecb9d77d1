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

_SHOWN = 2  # values
_ENDS = ("low", "high")  # of a value along a path


@dataclass(frozen=True)
class SweepRow:
    """What a sweep keeps of a combination."""

    rows: list[dict[str, Any]]
    folder: Path | None  # of the run
    failure: str | None  # why it has no value

    @classmethod
    def of(cls, combination: Combination, outcome: Outcome) -> SweepRow:
        """Of what its job has come to."""
        rows = rows_of(combination, outcome)
        if isinstance(outcome, PalpateError):
            return cls(rows, None, str(outcome))
        return cls(rows, outcome.result.folder, None)


def rows_of(combination: Combination, outcome: Outcome) -> list[dict[str, Any]]:
    """One row for each track of a combination; one with the reason where it failed."""
    head = {"combination": combination.number, **combination.values}
    if isinstance(outcome, PalpateError):
        return [{**head, "error": str(outcome)}]
    rows, result = [], outcome.result.table()
    for name, track in result["tracks"].items():
        row = {**head, "track": name}
        for parameter, found in {**track["parameters"], "surface": track["surface"]}.items():
            row |= {f"{parameter} [{found['unit']}]": found["value"], f"{parameter}_std": found["std"]}
            row |= {f"{parameter}_verdict": found["verdict"]} if "verdict" in found else {}
            row |= {f"{parameter}_{end}": found["places"][end] for end in _ENDS if "places" in found}
            row |= {
                f"{parameter}_{key}": found[key]
                for key in ("systematic", "systematic_places", "combined")
                if key in found
            }
        truth = {f"{parameter}_truth": value for parameter, value in result["truth"].items()}
        rows.append(row | truth | {key: track[key] for key in ("force_rms", "nis", "verdict", "flags")})
    return rows


def best_rows(rows: Sequence[dict[str, Any]], most: int = 12) -> Table:
    """Return the combinations with the smallest uncertainty of their first parameter, those that can be used first."""

    def cost(row: dict[str, Any]) -> tuple[int, float]:
        values = [_table_value(row, name, unit) for name, unit in _values([row]).items()][:1]
        shares = [abs(value.of_one_place / value.value) for value in values if value.value]
        return verdict_rank(row.get("verdict", "invalid")), min(filter(math.isfinite, shares), default=math.inf)

    kept = sorted((row for row in rows if "error" not in row), key=cost)[:most]
    swept = [key for key in (kept[0] if kept else {}) if "." in key]
    values = _values(kept)
    several = len({row["track"] for row in kept}) > 1
    cells = [
        [
            str(row["combination"]),
            *(str(row[key]) for key in swept),
            *([row["track"]] if several else []),
            *(cell for name, unit in values.items() for cell in _value(row, name, unit)),
        ]
        for row in kept
    ]
    names = [_short(key, swept) for key in swept]
    heads = [head for name, unit in values.items() for head in (f"{name}\n{display_unit(unit)[0]}", f"{name}\nverdict")]
    headings = ["", *names, *(["track"] if several else []), *heads]
    title = f"best of {len(rows)} rows, by the uncertainty of {next(iter(values), 'nothing')}"
    return Table.of(with_legend(title), headings, cells, [*names, "track", *heads[1::2]])


def _values(rows: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """SI units of the values that are shown, by name: the first two parameters of the rows."""
    keys = dict.fromkeys(key for row in rows for key in row if key.endswith("]") and not key.startswith("surface"))
    return {name: unit for name, _, unit in (key.rstrip("]").partition(" [") for key in list(keys)[:_SHOWN])}


def sweep_doubt_lines(rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    """What was found, once for all combinations that share it, and how many have which word for each value."""
    table = ResultTable(tuple(map(_result_row, rows)), thing="row")
    yield from finding_lines(table)
    yield from filled(table.partition(), "  ")


def _result_row(row: Mapping[str, Any]) -> ResultRow:
    """Return a row as one of the table of results."""
    head = f"{row['combination']}"
    if "error" in row:
        return ResultRow(head, "", error=str(row["error"]))
    values = {name: _table_value(row, name, unit) for name, unit in _values([row]).items()}
    numbers = {name: value.value for name, value in values.items()}
    flags = (Flag.of_table(flag) for flag in row.get("flags", ()))
    findings = tuple(ResultFinding.of_flag(flag, numbers) for flag in flags)
    return ResultRow(head, str(row["track"]), values, findings=findings)


def _table_value(row: Mapping[str, Any], name: str, unit: str) -> TableValue:
    value, combined = row.get(f"{name} [{unit}]"), row.get(f"{name}_combined")
    verdict = row.get(f"{name}_verdict") or row.get("verdict", "")
    keys = {**{end: f"{name}_{end}" for end in _ENDS}, "spread": f"{name}_systematic_places"}
    places = {place: row[key] for place, key in keys.items()} if keys["low"] in row else {}
    return TableValue(name, value, math.nan if combined is None else combined, unit, verdict, places)


def _short(key: str, others: Sequence[str]) -> str:
    """Return the last word of a setting, or all of it where another one ends alike."""
    last = key.rpartition(".")[2]
    return last if sum(other.rpartition(".")[2] == last for other in others) == 1 else key


def _value(row: dict[str, Any], name: str, unit: str) -> tuple[str, str]:
    """Number and verdict of a value."""
    value = _table_value(row, name, unit)
    return "\n".join(value.number_lines), value.word


def write_rows(folder: Path, rows: Sequence[dict[str, Any]]) -> None:
    """``sweep.csv`` and ``sweep.json``."""
    columns = list(dict.fromkeys(column for row in rows for column in row if column not in ("flags", "error")))
    columns += ["flags", "error"]
    with whole_file(folder / "sweep.csv") as file:
        table = csv.DictWriter(file, columns, restval="", lineterminator="\n")
        table.writeheader()
        table.writerows({**row, "flags": _told(row)} for row in rows)
    write_whole(folder / "sweep.json", json.dumps(rows, indent=2, allow_nan=False) + "\n")


def _told(row: dict[str, Any]) -> str:
    return "; ".join(f"{flag['code']}: {flag['message']}" for flag in row.get("flags", []))
