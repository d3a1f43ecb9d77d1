"""``pipeline.toml`` of a folder of fits: one pipeline for each dialect in which its curves are written."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomli_w
from palpate import ConfigurationError, LogError
from palpate_engine import DIALECT, bounded_text, dialect_tables, toml_tables, with_dialect, write_whole

from palpate_kit.curves.curve_list import RECORD

SETTINGS = "pipeline.toml"
CURVES = "curves"  # key of its [run]: the folder from which the files of curves are seen


def reading_keys(device: str) -> tuple[str, ...]:
    """Keys of a pipeline that say where one of the curves is, and not how it is read."""
    return f"device.{device}.file", f"device.{device}.{RECORD}", f"run.{CURVES}"


def curves_folder(folder: Path) -> Path | None:
    """Return the folder from which the files of curves are seen, as the pipeline states it; None where it states
    none."""
    stated = _run_table(_settings(folder / SETTINGS)).get(CURVES)
    return Path(os.path.normpath(folder.resolve() / str(stated))) if stated else None


def settings_text(path: Path, dialect: str = "") -> str:
    """Return the pipeline of a folder of fits by which files of a dialect are read, wherever these are; raises
    LogError."""
    try:
        return tomli_w.dumps(without_curves_folder(dialect_tables(_settings(path), dialect)))
    except ConfigurationError as error:
        raise LogError(f"{path}: {error}") from error


def without_curves_folder(tables: Mapping[str, Any]) -> dict[str, Any]:
    """Return the tables of a pipeline of a folder of fits but for where its curves are."""
    if CURVES not in (run := _run_table(tables)):
        return {**tables}
    return {**tables, "run": {key: value for key, value in run.items() if key != CURVES}}


def dialects_in(path: Path) -> list[str]:
    """Return the dialects of the pipeline of a folder of fits, its own tables first, which have no name; raises
    LogError."""
    return ["", *_settings(path).get(DIALECT, {})]


def write_dialects(path: Path, texts: Mapping[str, str]) -> None:
    """Write pipelines by dialect into the one file of a folder of fits; raises LogError, OutputError."""
    before = _settings(path)
    tables = toml_tables(texts[""]) if "" in texts else before
    order = _run_table(before)
    if stated := order.get(CURVES):
        run = {**_run_table(tables), CURVES: stated}
        tables["run"] = {key: run[key] for key in (*order, *run) if key in run}  # as before: undo gives the same bytes
    for name, text in texts.items():
        tables = with_dialect(tables, name, toml_tables(text)) if name else tables
    write_whole(path, tomli_w.dumps(tables))


def _run_table(tables: Mapping[str, Any]) -> dict[str, Any]:
    """Return the table ``[run]``; empty if it is not a table, which whoever builds the pipeline says."""
    run = tables.get("run")
    return run if isinstance(run, dict) else {}


def _settings(path: Path) -> dict[str, Any]:
    try:
        return toml_tables(bounded_text(path))
    except (OSError, UnicodeDecodeError) as error:
        raise LogError(f"{path}: cannot be read: {error}") from error
    except tomllib.TOMLDecodeError as error:
        raise LogError(f"{path}: is a damaged pipeline: {error}") from error
