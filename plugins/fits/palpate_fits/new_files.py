"""Files that have come into the folder of the curves since these were fitted."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import tomli_w
from palpate import ConfigurationError, UserError, to_si
from palpate_engine import (
    RIG,
    Pipeline,
    Registry,
    RigFacts,
    Source,
    build_pipeline,
    inherited_approval,
    registry,
    resolved_text,
    toml_tables,
)
from palpate_kit.curves.alike_logs import LogPart, logs_among, specimens_of
from palpate_kit.curves.curve import Curve
from palpate_kit.curves.curve_list import add_curves
from palpate_kit.curves.file_facts import file_facts
from palpate_kit.curves.fit_folder import FitFolder
from palpate_kit.curves.folder_settings import SETTINGS, reading_keys, write_dialects
from palpate_kit.curves.stated_facts import StatedFacts, suggestion_by_facts
from palpate_kit.logs.role_guess import ROLES
from palpate_kit.logs.suggestion import UNITS
from palpate_kit.runs.pipeline_diff import differences
from palpate_records.recording import Suggestion

from palpate_fits.file_pipelines import DEVICE
from palpate_fits.file_questions import question_of_file

_PLACES = ("lateral_x", "lateral_y")
_OF_RECORD = ("tare", "tare_duration")  # keys of the alignment that a record suggests where nobody states them


def add_new_files(path: Path) -> tuple[list[str], dict[str, str]]:
    """Append the new files of the curves' folder to the list of a folder of fits, each in its dialect.

    Return the names of the curves that were added, and for each of the others the reason why it cannot be read. Raises
    UserError for a folder of fits that is damaged.
    """
    folder = FitFolder(path)
    curves_folder = folder.curves_folder
    if curves_folder is None or not curves_folder.is_dir():
        return [], {}
    part_registry = registry.load()
    listed = {(curve.file, curve.record) for curve in folder.curves()}
    prefix = _prefix(folder, curves_folder)
    added: list[str] = []
    refused: dict[str, str] = {}
    # Each file, or record of a file, that the folder does not list; its name is relative to the curves' folder.
    for record in _records_below(curves_folder, part_registry):
        if (str(record.path), record.part) in listed:
            continue
        name = f"{prefix}{LogPart(record.path.relative_to(curves_folder), record.part)}"
        curve = Curve(name, str(record.path), record=record.part)
        facts = file_facts([curves_folder], [curve], StatedFacts(RigFacts(), path / RIG))
        try:
            dialect = _dialect(folder, record, facts.of(name).facts, part_registry)
        except UserError as error:
            refused[name] = str(error).removeprefix(f"{record.path}: ")
            continue
        add_curves(path, [curve], dialect, facts.cells, curves_folder)
        added.append(name)
        folder = FitFolder(path)  # read again: the dialect of the next curve may be one that this one has brought
    return added, refused


def _records_below(place: Path, kinds_of_parts: Registry) -> Iterator[LogPart]:
    """Yield each record of each log in a folder."""
    for log in logs_among([place], kinds_of_parts):
        yield from specimens_of(log, kinds_of_parts)


def _prefix(folder: FitFolder, place: Path) -> str:
    """Return the folder as it was given, with which the names of curves begin."""
    for curve in folder.curves():
        if place not in Path(curve.file).parents:
            continue
        suffix = str(LogPart(Path(curve.file).relative_to(place), curve.record))
        if curve.name.endswith(suffix):
            return curve.name.removesuffix(suffix)
    return ""


def _dialect(folder: FitFolder, part: LogPart, facts: RigFacts, part_registry: Registry) -> str:
    """Return the name of the dialect in which a file is written, a new one where it matches none of the others.

    The dialects of a folder of fits differ in how files are read, and have a pipeline each. Raises UserError.
    """
    new_text: str | None = None
    problem: UserError | None = None
    for name in (*folder.dialects, None):  # the last by what the file states alone
        tables = toml_tables(folder.settings_text(name or ""))
        choices = _choices(tables["device"][DEVICE]) if name is not None else {}
        try:
            suggestion = suggestion_by_facts(part.path, facts, {**choices, **part.choices}, part_registry)
            if (question := question_of_file(suggestion, {})) is not None and (question.needed or name is None):
                raise ConfigurationError(question.advice)
            text = resolved_text(_pipeline(folder, tables, suggestion), folder.path)
        except UserError as error:
            problem = error
            continue
        # A dialect whose pipeline has the same settings of the reader.
        if name is not None and not differences(text, folder.settings_text(name), reading_keys(DEVICE)):
            return name
        new_text = new_text or text
    if new_text is None:
        assert problem is not None
        raise problem
    # The first dialect has another name; the others are d2, d3 and so on.
    number = 2
    while (new := f"d{number}") in folder.dialects:
        number += 1
    write_dialects(folder.path / SETTINGS, {new: new_text})
    return new


def _choices(device: Mapping[str, Any]) -> dict[str, str]:
    """Return the choices that make a file be read as by a device: its columns, their units and the rate, or its
    signals."""
    if "signals" in device:
        signals = device["signals"]
        return {role: f"{signals[role]['topic']}:{_field(signals[role])}" for role in ROLES if role in signals}
    columns = device.get("columns", {})
    choices = {role: str(columns[role]["column"]) for role in ROLES if role in columns}
    choices |= {f"{UNITS}{column['column']}": f"{column['scale']:g} {column['unit']}" for column in columns.values()}
    if "time" in device:
        choices["time"] = str(device["time"]["column"])
    return choices | ({"rate": f"{device['rate']} Hz"} if "rate" in device else {})


def _field(signal: Mapping[str, Any]) -> str:
    """Return a number of a topic as a choice names it: of a child frame that frame."""
    if "select" in signal:
        return str(signal["select"])
    return f"{signal['field']}[{signal['index']}]" if "index" in signal else str(signal["field"])


def _pipeline(folder: FitFolder, tables: Mapping[str, Any], suggestion: Suggestion) -> Pipeline:
    """Return the pipeline of a dialect with another device, and what its record suggests where nobody has stated it.

    `suggestion` says how the record would be read by itself, `tables` are those of the dialect. The record's own are
    the places along the skin, and the tare where that of the dialect was assumed. Of the gap between readings the
    longer one is taken.
    """
    record_keys = _PLACES if "alignment.tare" not in tables["run"].get("assumed", ()) else (*_PLACES, *_OF_RECORD)
    alignment = {key: value for key, value in tables["alignment"].items() if key not in record_keys}
    for key, value in suggestion.alignment.items():
        if isinstance(value, dict):
            alignment[key] = {**alignment.get(key, {}), **value}
        elif key in record_keys:
            alignment[key] = value
        elif key == "gap":
            alignment[key] = max(alignment.get(key, 0.0), to_si(value, "s"))
    device = {key: value for key, value in suggestion.device.items() if value is not None}
    source = Source(
        tomli_w.dumps({**tables, "device": {DEVICE: device}, "alignment": alignment}), folder.path / SETTINGS
    )
    with inherited_approval(folder.approved):
        return build_pipeline(source)
