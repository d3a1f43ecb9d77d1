"""Every value of many runs and curves, a row each with specimen, rig, tip and date: a table of years of palpations."""

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

from palpate_studies.parameter_values import report_left_out

_FIT = "fit.json"
# Columns of curves.csv, of which the first one that has a cell counts.
_SPECIMEN_COLUMNS = ("specimen", "sample")
_DATE_COLUMNS = ("date", "day")
_RIG_COLUMNS = ("rig", "instrument")


@dataclass(frozen=True)
class ValueRow:
    """One value of a run, a log or a curve, with its verdict and the facts of its record."""

    record: str  # run folder or folder of fits
    curve: str  # or log; "" of a run
    track: str
    parameter: str
    value: float | None  # [SI]
    combined: float | None  # [SI] standard uncertainty
    unit: str
    verdict: str
    rejected: str  # the reason; "" if it was not rejected
    conditions: str
    flags: str
    specimen: str
    rig: str
    tip: str
    date: str
    columns: Mapping[str, str] = field(default_factory=dict)  # of ``curves.csv``


def columns_of_rows(rows: Sequence[ValueRow]) -> dict[str, Column]:
    """Return the table of rows by column, those of ``curves.csv`` last."""
    field_names = [name for name in ValueRow.__dataclass_fields__ if name != "columns"]
    table: dict[str, Column] = {name: [getattr(row, name) for row in rows] for name in field_names}
    for name in dict.fromkeys(column for row in rows for column in row.columns if column not in field_names):
        table[name] = [row.columns.get(name, "") for row in rows]
    return table


def records_under(sources: Sequence[Path]) -> list[Path]:
    """Return files, run folders and folders of fits at any depth of folders, in the natural order.

    Raises ConfigurationError without any.
    """
    records: list[Path] = []
    for source in sources:
        if not source.is_dir():
            records.append(source)
            continue
        for folder, subfolders, files in os.walk(source):
            if {RESULT, TABLE, _FIT} & set(files):
                records.append(Path(folder))
                subfolders.clear()  # pages on single curves of a folder of fits are not records of their own
    if not records:
        names = ", ".join(map(str, sources))
        raise ConfigurationError(f"{names}: holds no run and no fits" if names else "name at least one folder of runs")
    return sorted(set(records), key=natural)


def value_rows(record: Path, where: str | None) -> Iterator[ValueRow]:
    """Yield the values of a run folder, of a result, or of a folder of fits; raises UserError."""
    if (record / TABLE).is_file():
        yield from _curve_rows(FitFolder(record), where)
        return
    if where is not None:
        raise ConfigurationError(f"--where: {record} is not a folder of fits of many curves")
    file = record
    if not record.is_file():
        file = next((record / name for name in (_FIT, RESULT) if (record / name).is_file()), record)
    results, folder = read_results(file), RunFolder(file.parent)
    rejected, tables = folder.rejected, _pipeline_tables(folder)
    for log in sorted(results.by_log, key=natural):
        document = results.by_log[log]
        for track in document["tracks"]:
            yield from _track_rows(record, log, document, track, tables, rejected.get(log, ""))


def _track_rows(
    record: Path, log: str, document: Mapping[str, Any], track: str, tables: Mapping[str, Any], rejected: str
) -> Iterator[ValueRow]:
    """Yield the values of a track in the document of a run or log, by the tables of its pipeline."""
    run, result = document["run"], document["tracks"][track]
    conditions = "; ".join(f"{condition['fact']}: {condition['message']}" for condition in result.get("conditions", ()))
    flags = " ".join(dict.fromkeys(flag["code"] for flag in result["flags"]))
    rig = _rig(tables.get("device", {}), run["inputs"])
    tip = _tip_of_model(tables, result["model"])
    for parameter, estimate in {**result["parameters"], **result.get("derived", {})}.items():
        yield ValueRow(
            record=str(record),
            curve=log,
            track=track,
            parameter=parameter,
            value=estimate["value"],
            combined=estimate.get("combined"),
            unit=estimate["unit"],
            verdict=estimate.get("verdict") or result["verdict"],
            rejected=rejected,
            conditions=conditions,
            flags=flags,
            specimen=run["name"],
            rig=rig,
            tip=tip,
            date=run["started"],
        )


def _curve_rows(folder: FitFolder, where: str | None) -> Iterator[ValueRow]:
    """Yield the values of the curves of a folder of fits for which the filter words `where` hold."""
    rows = curve_filter(where, folder, registry.load().meanings).choose(folder.rows)
    tables: dict[str, dict[str, Any]] = {}  # of pipelines, by the names of settings
    for row in sorted((row for row in rows if row.track), key=lambda row: natural(row.curve)):
        if (key := folder.key(row.curve)) not in tables:
            tables[key] = _tables_of_curve(folder, row.curve)
        tip = _tip_of_model(tables[key], row.track.partition("/")[0])
        cells = {name: row.groups.get(name, "") for name in folder.columns}
        for name in folder.values:
            if name != "surface":
                yield ValueRow(
                    str(folder.path), row.curve, row.track, name, row.number(name), row.number(f"{name}_combined"),
                    folder.units.get(name, ""), row.verdict_of(name) or row.verdict, row.rejected or "",
                    row.cells.get("conditions") or "", " ".join(row.flags), _first_cell(cells, _SPECIMEN_COLUMNS),
                    _first_cell(cells, _RIG_COLUMNS), tip, _first_cell(cells, _DATE_COLUMNS), cells,
                )  # fmt: skip


def _first_cell(cells: Mapping[str, str], columns: Sequence[str]) -> str:
    """Return the first cell of some columns that is not empty; "" without one."""
    return next((cells[column] for column in columns if cells.get(column)), "")


def _tables_of_curve(folder: FitFolder, curve: str) -> dict[str, Any]:
    """Return the tables of the pipeline of a curve, with its own settings, and its facts if its tips can be built."""
    source = Source(folder.settings_text(folder.dialect_of(curve)), folder.path / SETTINGS)
    for assignment in folder.settings_of(curve):
        source.override(assignment)
    with suppress(PalpateError):
        build_parts(source, "indenter", registry.load())  # which enters the facts
    return source.tables


def _pipeline_tables(folder: RunFolder) -> dict[str, Any]:
    """Return the tables of the pipeline of a run; empty if its file is missing."""
    try:
        return folder.settings
    except LogError:
        return {}


def _rig(devices: Mapping[str, Mapping[str, Any]], inputs: Mapping[str, str]) -> str:
    """Return the devices as "NAME: TYPE", with the inputs of the run that identify each, such as serial numbers."""
    texts = []
    for name, table in devices.items():
        identities = [text for key, text in inputs.items() if key.startswith(f"{name}.") and is_identity(key)]
        texts.append(" ".join([f"{name}: {table.get('type', '')}", *identities]))
    return "; ".join(texts)


def _tip_of_model(tables: Mapping[str, Any], model: str) -> str:
    """Return the tip of a model of a pipeline in words; "" without one."""
    stated = tables.get("model", {}).get(model, {}).get("indenter")
    # The model names its tip, or has the table of one: of a curve with a tip of its own.
    tip = tables.get("indenter", {}).get(stated) if isinstance(stated, str) else stated
    return "" if tip is None else _tip_text(json.dumps(tip, sort_keys=True))


@cache  # years of runs have a handful of tips
def _tip_text(table: str) -> str:
    """Return the tip of a table in JSON in words; its type alone if the tip cannot be built."""
    tip, plugins = json.loads(table), registry.load()
    source = Source(tomli_w.dumps({"indenter": {"tip": tip}}), Path(PIPELINE))
    try:
        return tip_words(build_parts(source, "indenter", plugins)["tip"], plugins)
    except PalpateError:  # of a plugin that is not installed, or with a file of its own
        return str(tip.get("type", ""))


def write_value_table(
    path: Path, sources: Sequence[Path], track: str | None, parameter: str | None, where: str | None
) -> int:
    """Write the values of all records under the sources, and return the number of records that could not be read.

    `track` and `parameter` None are all, `where` filter words for curves. Raises ConfigurationError without a value,
    the UserError of the first record if none can be read, OutputError.
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
    report_left_out(failures, has_values=bool(rows))
    rows = _select_rows(rows, column="track", name=track)
    rows = _select_rows(rows, column="parameter", name=parameter)
    if not rows:
        condition = f" where {where!r}" if where else ""
        raise ConfigurationError(f"{', '.join(map(str, sources))}: no record has a value{condition}")
    write_table(path, columns_of_rows(rows))
    typer.echo(f"{path}: {len(rows)} values of {len(records) - len(failures)} records")
    return len(failures)


def _select_rows(rows: list[ValueRow], *, column: str, name: str | None) -> list[ValueRow]:
    """Return the rows with a track or parameter of a name, all of them for None.

    Raises ConfigurationError, which names the option of the column, for a name that no row has.
    """
    if name is None:
        return rows
    names = dict.fromkeys(getattr(row, column) for row in rows)
    if name not in names:
        raise ConfigurationError(f"--{column} {name}: no record has it{suggest(name, names)}")
    return [row for row in rows if getattr(row, column) == name]
