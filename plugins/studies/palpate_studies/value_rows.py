"""Every value of many runs and curves, a row each, with what it holds for: for a table of years of palpations."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import tomli_w
import typer
from palpate import ConfigurationError, LogError, PalpateError, UserError, suggest
from palpate_engine import PIPELINE, RESULT, Source, build_parts, registry
from palpate_kit.curves.curve_filter import curve_filter
from palpate_kit.curves.curve_table import TABLE
from palpate_kit.curves.fit_folder import FitFolder
from palpate_kit.curves.folder_settings import SETTINGS
from palpate_kit.runs.device_identity import is_identity
from palpate_kit.runs.result_file import read_results
from palpate_kit.runs.run_folder import RunFolder
from palpate_kit.runs.run_groups import natural
from palpate_kit.terminal.fact_line import tip_words
from palpate_kit.terminal.progress import progress, report_progress
from palpate_kit.terminal.table_file import Column, demand_suffix, write_table

from palpate_studies.parameter_values import tell_left_out

_FIT = "fit.json"
_SPECIMENS, _DATES, _RIGS = ("specimen", "sample"), ("date", "day"), ("rig", "instrument")


@dataclass(frozen=True)
class ValueRow:
    """One value of a run, a log or a curve, with what is known of it."""

    record: str  # run folder or folder of fits
    curve: str  # or log; "" of a run
    track: str
    parameter: str
    value: float | None  # [SI]
    combined: float | None  # [SI] standard uncertainty
    unit: str
    verdict: str
    rejected: str  # why; "" where it was not
    conditions: str
    flags: str
    specimen: str
    rig: str
    tip: str
    date: str
    columns: Mapping[str, str] = field(default_factory=dict)  # of ``curves.csv``


def columns_of_rows(rows: Sequence[ValueRow]) -> dict[str, Column]:
    """Return the table of rows by column, those of ``curves.csv`` last."""
    own = [name for name in ValueRow.__dataclass_fields__ if name != "columns"]
    found: dict[str, Column] = {name: [getattr(row, name) for row in rows] for name in own}
    for name in dict.fromkeys(column for row in rows for column in row.columns if column not in own):
        found[name] = [row.columns.get(name, "") for row in rows]
    return found


def records_under(sources: Sequence[Path]) -> list[Path]:
    """Run folders and folders of fits at any depth, in the natural order; raises ConfigurationError where none is."""
    found: list[Path] = []
    for source in sources:
        if not source.is_dir():
            found.append(source)
            continue
        for place, folders, files in os.walk(source):
            if {RESULT, TABLE, _FIT} & set(files):
                found.append(Path(place))
                folders.clear()  # pages on single curves of a folder of fits are not records of their own
    if not found:
        named = ", ".join(map(str, sources))
        raise ConfigurationError(f"{named}: holds no run and no fits" if named else "name at least one folder of runs")
    return sorted(set(found), key=natural)


def value_rows(record: Path, where: str | None) -> Iterator[ValueRow]:
    """Yield the values of a run folder, of a result, or of a folder of fits; raises UserError."""
    if (record / TABLE).is_file():
        yield from _of_curves(FitFolder(record), where)
        return
    if where is not None:
        raise ConfigurationError(f"--where: {record} is not a folder of fits of many curves")
    file = record if record.is_file() else next((record / n for n in (_FIT, RESULT) if (record / n).is_file()), record)
    results, folder = read_results(file), RunFolder(file.parent)
    rejected, facts = folder.rejected, _facts_of_run(folder)
    for log in sorted(results.by_log, key=natural):
        document = results.by_log[log]
        run = document["run"]
        known = {"rig": _rig(facts.get("device", {}), run["inputs"]), "date": run["started"], "specimen": run["name"]}
        for track, table in document["tracks"].items():
            told = "; ".join(f"{one['fact']}: {one['message']}" for one in table.get("conditions", ()))
            codes = " ".join(dict.fromkeys(flag["code"] for flag in table["flags"]))
            for name, found in {**table["parameters"], **table.get("derived", {})}.items():
                yield ValueRow(
                    str(record), log, track, name, found["value"], found.get("combined"), found["unit"],
                    found.get("verdict") or table["verdict"], rejected.get(log, ""), told, codes,
                    tip=_tip_of(facts, table["model"]), **known,
                )  # fmt: skip


def _of_curves(folder: FitFolder, where: str | None) -> Iterator[ValueRow]:
    rows = curve_filter(where, folder, registry.load().meanings).choose(folder.rows)
    tables: dict[str, dict[str, Any]] = {}  # of pipelines, by the names of settings
    for row in sorted((row for row in rows if row.track), key=lambda row: natural(row.curve)):
        if (key := folder.key(row.curve)) not in tables:
            tables[key] = _tables_of_curve(folder, row.curve)
        tip = _tip_of(tables[key], row.track.partition("/")[0])
        cells = {name: row.groups.get(name, "") for name in folder.columns}
        for name in folder.values:
            if name != "surface":
                yield ValueRow(
                    str(folder.path), row.curve, row.track, name, row.number(name), row.number(f"{name}_combined"),
                    folder.units.get(name, ""), row.verdict_of(name) or row.verdict, row.rejected or "",
                    row.cells.get("conditions") or "", " ".join(row.flags), _first(cells, _SPECIMENS),
                    _first(cells, _RIGS), tip, _first(cells, _DATES), cells,
                )  # fmt: skip


def _first(cells: Mapping[str, str], names: Sequence[str]) -> str:
    return next((cells[name] for name in names if cells.get(name)), "")


def _tables_of_curve(folder: FitFolder, curve: str) -> dict[str, Any]:
    """Return the tables of the pipeline of a curve, with its facts in them wherever its tips can be built."""
    source = Source(folder.settings_text(folder.dialect_of(curve)), folder.path / SETTINGS)
    for assignment in folder.settings_of(curve):
        source.override(assignment)
    with suppress(PalpateError):
        build_parts(source, "indenter", registry.load())
    return source.tables


def _facts_of_run(folder: RunFolder) -> dict[str, Any]:
    """Return the tables of the pipeline; none where it is not there any more."""
    try:
        return folder.settings
    except LogError:
        return {}


def _rig(devices: Mapping[str, Mapping[str, Any]], inputs: Mapping[str, str]) -> str:
    """Return the devices by name and type, with what identifies them."""
    told = []
    for name, table in devices.items():
        marks = [text for key, text in inputs.items() if key.startswith(f"{name}.") and is_identity(key)]
        told.append(" ".join([f"{name}: {table.get('type', '')}", *marks]))
    return "; ".join(told)


def _tip_of(tables: Mapping[str, Any], model: str) -> str:
    """Return the tip of a model of a pipeline in words; "" where it has none."""
    stated = tables.get("model", {}).get(model, {}).get("indenter")
    # A curve's own tip stands in the table of its model where the others have none.
    tip = tables.get("indenter", {}).get(stated) if isinstance(stated, str) else stated
    return "" if tip is None else _words(json.dumps(tip, sort_keys=True))


@cache  # years of runs have a handful of tips
def _words(table: str) -> str:
    tip, known = json.loads(table), registry.load()
    source = Source(tomli_w.dumps({"indenter": {"tip": tip}}), Path(PIPELINE))
    try:
        return tip_words(build_parts(source, "indenter", known)["tip"], known)
    except PalpateError:  # of a plugin that is not there, or with a file of its own
        return str(tip.get("type", ""))


def write_value_table(
    path: Path, sources: Sequence[Path], track: str | None, parameter: str | None, where: str | None
) -> int:
    """Write the values of all records under the sources, and answer how many records could not be read.

    Raises ConfigurationError where none has a value, and what the only one raises.
    """
    demand_suffix(path, "--table")
    records = records_under(sources)
    rows: list[ValueRow] = []
    failures: dict[str, UserError] = {}
    with progress(f"values of {len(records)} records", "", len(records)):
        for number, record in enumerate(records, start=1):
            try:
                rows += value_rows(record, where)
            except UserError as error:
                failures[str(record)] = error.with_traceback(None)
            report_progress(number)
    tell_left_out(failures, others=bool(rows))
    for option, key, wanted in (("--track", "track", track), ("--parameter", "parameter", parameter)):
        known = dict.fromkeys(getattr(row, key) for row in rows)
        if wanted is not None and wanted not in known:
            raise ConfigurationError(f"{option} {wanted}: no record has it{suggest(wanted, known)}")
        rows = [row for row in rows if wanted in (None, getattr(row, key))]
    if not rows:
        raise ConfigurationError(
            f"{', '.join(map(str, sources))}: no record has a value" + (f" where {where!r}" if where else "")
        )
    write_table(path, columns_of_rows(rows))
    typer.echo(f"{path}: {len(rows)} values of {len(records) - len(failures)} records")
    return len(failures)
