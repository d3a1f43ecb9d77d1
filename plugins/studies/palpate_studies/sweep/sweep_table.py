"""One table of all combinations, a row for each track."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from palpate import PalpateError
from palpate.host import display_unit, whole_file, write_whole
from palpate_kit.jobs.job import Outcome
from palpate_kit.terminal.quantities import value_with_uncertainty
from palpate_kit.terminal.table import Table

from palpate_studies.sweep.combinations import Combination

_VERDICTS = ("good", "note", "doubtful", "invalid")


@dataclass(frozen=True)
class SweepRow:
    """What a sweep keeps of a combination."""

    rows: list[dict[str, Any]]
    folder: Path | None  # of the run
    failure: str | None  # why there is none

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
            share = abs(math.sqrt(max(combined**2 - places**2, 0.0)) / value)  # how places differ is no error
        return _VERDICTS.index(row.get("verdict", "invalid")), share

    kept = sorted((row for row in rows if "error" not in row), key=cost)[:most]
    swept = [key for key in (kept[0] if kept else {}) if "." in key]
    cells = [[str(row["combination"]), *(str(row[key]) for key in swept), row["track"], *_numbers(row)] for row in kept]
    headings = ["number", *swept, "track", "estimate", "NIS", "verdict"]
    return Table.of(f"best of {len(rows)} rows", headings, cells, [*swept, "track", "verdict"])


def _value_key(row: dict[str, Any]) -> str:
    return next((key for key in row if key.endswith("]") and not key.startswith("surface")), "")


def _combined_key(row: dict[str, Any]) -> str:
    return f"{_value_key(row).partition(' [')[0]}_combined"


def _numbers(row: dict[str, Any]) -> list[str]:
    name, _, unit = _value_key(row).rstrip("]").partition(" [")
    word, factor = display_unit(unit)
    value, combined = row.get(_value_key(row)), row.get(_combined_key(row))
    shown = value_with_uncertainty(value * factor, (combined or math.nan) * factor) if isinstance(value, float) else "-"
    nis = row.get("nis")
    return [f"{name} {shown} {word}", f"{nis:.2f}" if isinstance(nis, float) else "-", row.get("verdict", "")]


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
