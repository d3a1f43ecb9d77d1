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
CURVES = "curves"  # key of its [run]: the folder to which the files of curves are relative


def reading_keys(device: str) -> tuple[str, ...]:
    """Return the keys of a pipeline that state the place of a curve, and not how it is read."""
    return f"device.{device}.file", f"device.{device}.{RECORD}", f"run.{CURVES}"


def curves_folder(folder: Path) -> Path | None:
    """Return the folder to which the files of curves are relative; None unless the pipeline states one."""
    stated_path = _run_table(_read_tables(folder / SETTINGS)).get(CURVES)
    return Path(os.path.normpath(folder.resolve() / str(stated_path))) if stated_path else None


def settings_text(path: Path, dialect: str = "") -> str:
    """Return the pipeline by which files of a dialect are read, without the place of the files; raises LogError."""
    try:
        return tomli_w.dumps(without_curves_folder(dialect_tables(_read_tables(path), dialect)))
    except ConfigurationError as error:
        raise LogError(f"{path}: {error}") from error


def without_curves_folder(tables: Mapping[str, Any]) -> dict[str, Any]:
    """Return the tables of a pipeline without the folder to which the files of curves are relative."""
    if CURVES not in (run := _run_table(tables)):
        return {**tables}
    return {**tables, "run": {key: value for key, value in run.items() if key != CURVES}}


def dialects_in(path: Path) -> list[str]:
    """Return the dialects of a pipeline, "" for its main tables first; raises LogError."""
    return ["", *_read_tables(path).get(DIALECT, {})]


def write_dialects(path: Path, texts: Mapping[str, str]) -> None:
    """Write pipelines by dialect into the one file of a folder of fits; raises LogError, OutputError."""
    tables_before = _read_tables(path)
    tables = toml_tables(texts[""]) if "" in texts else tables_before
    run_before = _run_table(tables_before)
    if stated_path := run_before.get(CURVES):
        run = {**_run_table(tables), CURVES: stated_path}
        # In the order of before, so that the undo of a change gives the same bytes.
        tables["run"] = {key: run[key] for key in (*run_before, *run) if key in run}
    for name, text in texts.items():
        tables = with_dialect(tables, name, toml_tables(text)) if name else tables
    write_whole(path, tomli_w.dumps(tables))


def _run_table(tables: Mapping[str, Any]) -> dict[str, Any]:
    """Return the table ``[run]``; empty if it is not a table, an error that the pipeline reports when it is built."""
    run = tables.get("run")
    return run if isinstance(run, dict) else {}


def _read_tables(path: Path) -> dict[str, Any]:
    """Return the tables of a pipeline file; raises LogError for one that cannot be read."""
    try:
        return toml_tables(bounded_text(path))
    except (OSError, UnicodeDecodeError) as error:
        raise LogError(f"{path}: cannot be read: {error}") from error
    except tomllib.TOMLDecodeError as error:
        raise LogError(f"{path}: is a damaged pipeline: {error}") from error
