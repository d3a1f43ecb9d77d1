"""Messages to the page on a folder: rows in display units, groups, settings, and exports."""

from __future__ import annotations

import asyncio
import json
import math
import shlex
import sys
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from palpate import ConfigurationError
from palpate_engine import display_unit, registry, write_whole
from palpate_kit.curves.curve_list import FACTS
from palpate_kit.curves.curve_row import CurveRow
from palpate_kit.curves.fit_folder import FitFolder
from palpate_kit.curves.folder_settings import SETTINGS
from palpate_kit.curves.row_results import result_row
from palpate_kit.figures import force_unit

from palpate_desk import page_messages
from palpate_desk.action import OUT, Action, where_curve
from palpate_desk.command_gate import demand_allowed
from palpate_desk.desk import Desk

_COMMAND = "import sys; from palpate_engine.cli import main; main(sys.argv[2:], sys.argv[1].split())"
_UNIT_ROWS = 200  # by which the unit of residuals is chosen: a choice
_SHOWN_LINES = 2  # of the output of a command, the last ones: a choice
_USAGE_ERROR = 2  # exit code of a command that refuses its arguments
_MILLIMETRE = 1e3  # [1/m]


def row_messages(folder: FitFolder, rows: Iterable[CurveRow]) -> list[dict[str, Any]]:
    """Return rows for the page: values as numbers and as text in display units, each with its verdict."""
    units = {name: folder.units.get(name, "") for name in _shown_values(folder)}
    _, force_factor = _residual_unit(folder)
    return [_row_message(row, units, force_factor) for row in rows]


def _residual_unit(folder: FitFolder) -> tuple[str, float]:
    """Return the unit in which the residuals of a folder are shown, and how many of it one newton is."""
    residuals = [float(cells["rms"]) for cells in folder.cells[:_UNIT_ROWS] if cells.get("rms")]
    return force_unit(float(np.median(residuals)) if residuals else 1.0)


def _shown_values(folder: FitFolder) -> list[str]:
    """Return the names of the values that the page shows."""
    return [name for name in folder.values if name != "surface"]


def _row_message(row: CurveRow, units: dict[str, str], force_factor: float) -> dict[str, Any]:
    """Return a row for the page; `units` are SI, by value, `force_factor` is how many units of residuals one newton is.

    A row is a curve's of the table of fits, with its mark and its cells of ``curves.csv``. Of each value: number and
    uncertainty (None: not known) in display units, and the text.
    """
    values: dict[str, Any] = {}
    table_values = result_row(row.cells, units, {}).values
    for name, value in table_values.items():
        factor = display_unit(value.unit)[1]
        if value.value is not None and value.verdict != "invalid":
            uncertainty = None if math.isnan(value.combined) else value.combined * factor
            values[name] = [value.value * factor, uncertainty, value.number]
    residual = row.number("rms")
    return {
        "curve": row.curve, "track": row.track, "values": values,
        "verdicts": {name: value.word for name, value in table_values.items()},
        "rms": None if residual is None else f"{force_factor * residual:.3g}",
        "facts": {name: cell for name in FACTS if (cell := row.groups.get(name))},
        "flags": list(row.flags), "error": row.error, "mark": row.mark, "reason": row.rejected or "",
        "state": row.state, "groups": dict(row.groups), "place": row.place,
    }  # fmt: skip


def folder_message(desk: Desk) -> dict[str, Any]:
    """Return the message with everything that the page shows of a folder: rows in display units, settings, own ones.

    The first fit among the estimators is named, with the segment of a curve that it fits.
    """
    folder = desk.folder
    parts_registry = registry.load()
    tables = tomllib.loads(folder.settings_text())
    meanings = {
        code: {"severity": meaning.severity, "meaning": meaning.meaning, "remedy": meaning.remedy}
        for code, meaning in parts_registry.meanings.items()
    }
    units = {name: display_unit(folder.units.get(name, ""))[0] for name in _shown_values(folder)}
    estimators = tables.get("estimator", {})
    fit_name = next((name for name, table in estimators.items() if table.get("type") == "casadi-fit"), "")
    return {
        "kind": "folder", "name": str(folder.path), "units": units, "columns": folder.columns, "meanings": meanings,
        "residual_unit": _residual_unit(folder)[0], "group_by": _first_group(folder),
        "rows": row_messages(folder, folder.rows), "tip": _tip_words(tables),
        "model": next(iter(tables.get("model", {})), ""),
        "models": sorted(parts_registry.parts["model"]),
        "fit": fit_name, "segment": estimators.get(fit_name, {}).get("segment", ""),
        "own": {name: list(texts) for name, texts in folder.own.items()},
    }  # fmt: skip


def _first_group(folder: FitFolder) -> str:
    """Return the column to group by: the first that is not a fact, and that several but not all curves share."""
    for name in folder.columns:
        values = {cells.get(name, "") for cells in folder.entries.values()}
        if name not in FACTS and 1 < len(values) < len(folder.entries):
            return name
    return next((name for name in folder.columns if name not in FACTS), next(iter(folder.columns), ""))


def _tip_words(tables: dict[str, Any]) -> str:
    """Return the tip in words, as ``--tip`` takes it."""
    tip: dict[str, Any] = next(iter(tables.get("indenter", {}).values()), {})
    if tip.get("type") == "sphere":  # in words a ball; that of a pipeline is a paraboloid
        tip = {"type": "paraboloid", "curvature_radius": tip["radius"]}
    tip_words = [str(tip.get("type", ""))]
    for key, setting in tip.items():
        if key in ("radius", "curvature_radius", "tip_radius"):
            tip_words.append(f"{key} {_MILLIMETRE * setting:.6g} mm")
        elif key != "type":
            tip_words.append(f"{key} {setting}")
    return " ".join(tip_words)


async def exported(desk: Desk, message: page_messages.Question) -> dict[str, Any]:
    """Return the message to the page of an open folder (a desk) that answers its question.

    It holds the JSON of a command, statistics of groups or a comparison of models, or the last lines of an export.
    """
    if isinstance(message, page_messages.GroupsQuestion):
        action = Action("repeat", (("--by", message.by), ("--parameter", message.parameter), ("--json", "")))
        statistics = json.loads(await _output(action, desk))
        factor = display_unit(statistics["unit"])[1]  # from SI
        return {"kind": "groups", "found": statistics, "factor": factor, "command": action.text_for(str(desk.path))}
    if isinstance(message, page_messages.CompareQuestion):
        action = _comparison(desk, message)
        comparison = json.loads(await _output(action, desk))
        return {"kind": "compare", "found": comparison, "command": action.text_for(str(desk.path))}
    assert isinstance(message, page_messages.ExportOrder)
    desk.demand_no_links()
    if message.what == "history":
        script = desk.path / "history.sh"
        write_whole(script, desk.history.script)
        return {
            "kind": "export",
            "text": f"{script}",
            "command": f"palpate desk {shlex.quote(str(desk.path))} --history",
        }
    action = _export(desk, message)
    output = await _output(action, desk)
    last_lines = output.split("\n")[-_SHOWN_LINES - 1 :]  # the very last is empty
    return {"kind": "export", "text": " ".join(last_lines).strip(), "command": action.text_for(str(desk.path))}


def _comparison(desk: Desk, message: page_messages.CompareQuestion) -> Action:
    """Return the command that compares the folder's model with another one on a curve."""
    folder_models = tomllib.loads(desk.folder.settings_text()).get("model", {})
    models = dict.fromkeys((next(iter(folder_models)), message.model))
    where = where_curve(desk.curve(message.curve).name)
    return Action("fit choose", (("--models", ",".join(models)), ("--where", where), ("--json", "")))


def _export(desk: Desk, message: page_messages.ExportOrder) -> Action:
    """Return the command that writes a report, a map, a picture of groups, or the figures of a curve."""
    grouping = (("--by", message.by),) if message.by else ()
    parameter = (("--parameter", message.parameter),) if message.parameter else ()
    if message.what == "report":
        return Action("report", grouping)
    if message.what == "map":
        return Action("map", parameter)
    if message.what == "groups":
        return Action("repeat", (*grouping, *parameter, ("--picture", f"{OUT}/groups.svg")))
    curve = desk.curve(message.curve)
    name = Path(curve.name.replace("/", "_")).stem.strip(".") or "curve"
    return Action("fit", (("--pipeline", f"{OUT}/{SETTINGS}"), ("--out", f"{OUT}/figures/{name}")), curve.file)


async def _output(action: Action, desk: Desk) -> str:
    """Return the output of a command, in a process that executes only plugin files that were approved before.

    `desk` is the open folder, `action` a command on it with its options. Raises ConfigurationError with its errors
    where it fails.
    """
    demand_allowed(action)
    process = await asyncio.create_subprocess_exec(
        # -P: nothing is imported from the current folder.
        sys.executable, "-P", "-c", _COMMAND, " ".join(desk.folder.approved), *action.words(str(desk.path)),
        stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE,
    )  # fmt: skip
    output, errors = await process.communicate()
    if process.returncode == _USAGE_ERROR or not output.strip():
        raise ConfigurationError(
            errors.decode(errors="replace").strip().removeprefix("palpate: ") or "the command failed"
        )
    return output.decode(errors="replace")
