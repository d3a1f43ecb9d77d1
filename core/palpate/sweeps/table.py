"""One table of all combinations, a row for each track."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from palpate.sweeps.jobs import Job


def rows_of(job: Job, result: dict[str, Any]) -> list[dict[str, Any]]:
    """One row for each track of a combination; one with the reason where it failed."""
    head = {"combination": job.number, **job.values}
    if "error" in result:
        return [{**head, "error": result["error"]}]
    rows = []
    for name, track in result["tracks"].items():
        row = {**head, "track": name}
        for parameter, found in {**track["parameters"], "surface": track["surface"]}.items():
            row |= {f"{parameter} [{found['unit']}]": found["value"], f"{parameter}_std": found["std"]}
            row |= {f"{parameter}_{key}": found[key] for key in ("systematic", "combined") if key in found}
        truth = {f"{parameter}_truth": value for parameter, value in result["truth"].items()}
        rows.append(row | truth | {key: track[key] for key in ("force_rms", "nis", "flags")})
    return rows


def write_rows(folder: Path, rows: Sequence[dict[str, Any]]) -> None:
    """``sweep.csv`` and ``sweep.json``."""
    columns = list(dict.fromkeys(column for row in rows for column in row if column not in ("flags", "error")))
    columns += ["flags", "error"]
    partial = folder / "sweep.csv.part"
    with partial.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, columns, restval="", lineterminator="\n")
        table.writeheader()
        table.writerows({**row, "flags": "; ".join(row.get("flags", []))} for row in rows)
    partial.replace(folder / "sweep.csv")
    (folder / "sweep.json").write_text(json.dumps(rows, indent=2, allow_nan=False) + "\n", encoding="utf-8")
