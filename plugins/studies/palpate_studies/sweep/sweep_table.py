"""One table of all combinations, a row for each track."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from palpate import Flag, PalpateError
from palpate_engine import display_unit, verdict_rank, verdict_word, whole_file, write_whole
from palpate_kit.jobs.job import Outcome
from palpate_kit.terminal.flag_summary import summary_lines
from palpate_kit.terminal.quantities import value_with_uncertainty
from palpate_kit.terminal.table import Table

from palpate_studies.sweep.combinations import Combination

_SHOWN = 2  # values


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
            row |= {
                f"{parameter}_{key}": found[key]
                for key in ("systematic", "systematic_places", "combined")
                if key in found
            }
        truth = {f"{parameter}_truth": value for parameter, value in result["truth"].items()}
        rows.append(row | truth | {key: track[key] for key in ("force_rms", "nis", "verdict", "flags")})
    return rows


def best_rows(rows: Sequence[dict[str, Any]], most: int = 12) -> Table:
    """The combinations with the smallest uncertainty of their first parameter, those that can be used first."""

    def cost(row: dict[str, Any]) -> tuple[int, float]:
        value, combined = (row.get(key) for key in (_value_key(row), _combined_key(row)))
        share = math.inf
        if isinstance(value, float) and isinstance(combined, float) and value:
            places = row.get(_combined_key(row).replace("combined", "systematic_places")) or 0.0
            share = abs(math.sqrt(max(combined**2 - places**2, 0.0)) / value)  # how places differ is not an error
        return verdict_rank(row.get("verdict", "invalid")), share

    kept = sorted((row for row in rows if "error" not in row), key=cost)[:most]
    swept = [key for key in (kept[0] if kept else {}) if "." in key]
    values = _values(kept)
    several = len({row["track"] for row in kept}) > 1
    cells = [
        [
            str(row["combination"]),
            *(str(row[key]) for key in swept),
            *([row["track"]] if several else []),
            *(_value(row, name, unit) for name, unit in values.items()),
            verdict_word(row.get("verdict", "")),
        ]
        for row in kept
    ]
    names = [_short(key, swept) for key in swept]
    heads = [f"{name}\n{display_unit(unit)[0]}" for name, unit in values.items()]
    headings = ["", *names, *(["track"] if several else []), *heads, "verdict"]
    title = f"best of {len(rows)} rows, by the uncertainty of {next(iter(values), 'nothing')}"
    return Table.of(title, headings, cells, [*names, "track", "verdict"])


def _values(rows: Sequence[dict[str, Any]]) -> dict[str, str]:
    """SI units of the values that are shown, by name: the first two parameters of the rows."""
    keys = dict.fromkeys(key for row in rows for key in row if key.endswith("]") and not key.startswith("surface"))
    return {name: unit for name, _, unit in (key.rstrip("]").partition(" [") for key in list(keys)[:_SHOWN])}


def sweep_doubt_lines(rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    """The worst doubts of all rows, by the numbers of their combinations."""
    flags: dict[str, list[Flag]] = {}
    for row in rows:
        flags.setdefault(str(row["combination"]), []).extend(map(Flag.of_table, row.get("flags", ())))
    return summary_lines(flags)


def _short(key: str, others: Sequence[str]) -> str:
    """The last word of a setting, or all of it where another one ends alike."""
    last = key.rpartition(".")[2]
    return last if sum(other.rpartition(".")[2] == last for other in others) == 1 else key


def _value_key(row: dict[str, Any]) -> str:
    return next((key for key in row if key.endswith("]") and not key.startswith("surface")), "")


def _combined_key(row: dict[str, Any]) -> str:
    return f"{_value_key(row).partition(' [')[0]}_combined"


def _value(row: dict[str, Any], name: str, unit: str) -> str:
    factor = display_unit(unit)[1]
    value, combined = row.get(f"{name} [{unit}]"), row.get(f"{name}_combined")
    if not isinstance(value, float):
        return "-"
    return value_with_uncertainty(value * factor, (combined or math.nan) * factor)


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
