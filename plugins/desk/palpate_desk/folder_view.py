"""What the page gets of a folder: rows in display units, groups, settings, and what was exported."""

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

from palpate_desk import page_messages as asked
from palpate_desk.action import OUT, Action, where_curve
from palpate_desk.command_gate import demand_allowed
from palpate_desk.desk import Desk

_COMMAND = "import sys; from palpate_engine.cli import main; main(sys.argv[2:], sys.argv[1].split())"
_SAMPLE = 200  # rows by which the unit of residuals is chosen
_WORDS = 2  # of the longest answer of a command that is shown


def row_messages(folder: FitFolder, rows: Iterable[CurveRow]) -> list[dict[str, Any]]:
    """Rows for the page: values as numbers and as text in display units, each with its verdict."""
    units = {name: folder.units.get(name, "") for name in _shown(folder)}
    newtons = _residual_unit(folder)[1]
    return [_row(row, units, newtons) for row in rows]


def _residual_unit(folder: FitFolder) -> tuple[str, float]:
    """Return the unit in which the residuals of a folder are shown, and how many of it one newton is."""
    known = [float(cells["rms"]) for cells in folder.cells[:_SAMPLE] if cells.get("rms")]
    return force_unit(float(np.median(known)) if known else 1.0)


def _shown(folder: FitFolder) -> list[str]:
    return [name for name in folder.values if name != "surface"]


def _row(row: CurveRow, units: dict[str, str], newtons: float) -> dict[str, Any]:
    values: dict[str, Any] = {}
    shown = result_row(row.cells, units, {}).values
    for name, value in shown.items():
        factor = display_unit(value.unit)[1]
        if value.value is not None and value.verdict != "invalid":
            u = None if math.isnan(value.combined) else value.combined * factor
            values[name] = [value.value * factor, u, value.number]
    residual = row.number("rms")
    return {
        "curve": row.curve, "track": row.track, "values": values,
        "verdicts": {name: value.word for name, value in shown.items()},
        "rms": None if residual is None else f"{newtons * residual:.3g}",
        "facts": {name: cell for name in FACTS if (cell := row.groups.get(name))},
        "flags": list(row.flags), "error": row.error, "mark": row.mark, "reason": row.rejected or "",
        "state": row.state, "groups": dict(row.groups), "place": row.place,
    }  # fmt: skip


def folder_message(desk: Desk) -> dict[str, Any]:
    """Return all that the page shows of a folder."""
    folder, known = desk.folder, registry.load()
    tables = tomllib.loads(folder.settings_text())
    meanings = {
        code: {"severity": meaning.severity, "meaning": meaning.meaning, "remedy": meaning.remedy}
        for code, meaning in known.meanings.items()
    }  # fmt: skip
    units = {name: display_unit(folder.units.get(name, ""))[0] for name in _shown(folder)}
    estimators = tables.get("estimator", {})
    fit = next((name for name, table in estimators.items() if table.get("type") == "casadi-fit"), "")
    return {
        "kind": "folder", "name": str(folder.path), "units": units, "columns": folder.columns, "meanings": meanings,
        "residual_unit": _residual_unit(folder)[0], "group_by": _first_group(folder),
        "rows": row_messages(folder, folder.rows), "tip": _tip(tables),
        "model": next(iter(tables.get("model", {})), ""),
        "models": sorted(known.parts["model"]), "fit": fit, "segment": estimators.get(fit, {}).get("segment", ""),
        "own": {name: list(texts) for name, texts in folder.own.items()},
    }  # fmt: skip


def _first_group(folder: FitFolder) -> str:
    """Return the first column by which there are groups: no fact, and no value for each curve; else the first."""
    for name in folder.columns:
        values = {cells.get(name, "") for cells in folder.entries.values()}
        if name not in FACTS and 1 < len(values) < len(folder.entries):
            return name
    return next((name for name in folder.columns if name not in FACTS), next(iter(folder.columns), ""))


def _tip(tables: dict[str, Any]) -> str:
    """Return the tip as ``--tip`` takes it."""
    tip: dict[str, Any] = next(iter(tables.get("indenter", {}).values()), {})
    if tip.get("type") == "sphere":  # in words a ball; that of a pipeline is a paraboloid
        tip = {"type": "paraboloid", "curvature_radius": tip["radius"]}
    texts = [f"{key} {1e3 * value:.6g} mm" if key in ("radius", "curvature_radius", "tip_radius") else f"{key} {value}"
             for key, value in tip.items() if key != "type"]  # fmt: skip
    return " ".join([str(tip.get("type", "")), *texts])


async def exported(desk: Desk, message: asked.Question) -> dict[str, Any]:
    """Return the answer of a command: statistics of groups, models weighed, or what was written into the folder."""
    if isinstance(message, asked.GroupsQuestion):
        action = Action("repeat", (("--by", message.by), ("--parameter", message.parameter), ("--json", "")))
        found = json.loads(await _output(action, desk))
        factor = display_unit(found["unit"])[1]
        return {"kind": "groups", "found": found, "factor": factor, "command": action.text_for(str(desk.path))}
    if isinstance(message, asked.CompareQuestion):
        own = tomllib.loads(desk.folder.settings_text()).get("model", {})
        models = ",".join(dict.fromkeys((next(iter(own)), message.model)))
        chosen = ("--where", where_curve(desk.curve(message.curve).name))
        action = Action("fit choose", (("--models", models), chosen, ("--json", "")))
        found = json.loads(await _output(action, desk))
        return {"kind": "compare", "found": found, "command": action.text_for(str(desk.path))}
    assert isinstance(message, asked.ExportOrder)
    desk.demand_no_links()
    if message.what == "history":
        write_whole(desk.path / "history.sh", desk.history.script)
        command = f"palpate desk {shlex.quote(str(desk.path))} --history"
        return {"kind": "export", "text": f"{desk.path / 'history.sh'}", "command": command}
    action = _export(desk, message)
    text = await _output(action, desk)
    last = " ".join(text.split("\n")[-_WORDS - 1 :]).strip()
    return {"kind": "export", "text": last, "command": action.text_for(str(desk.path))}


def _export(desk: Desk, message: asked.ExportOrder) -> Action:
    by = (("--by", message.by),) if message.by else ()
    parameter = (("--parameter", message.parameter),) if message.parameter else ()
    if message.what == "report":
        return Action("report", by)
    if message.what == "map":
        return Action("map", parameter)
    if message.what == "groups":
        return Action("repeat", (*by, *parameter, ("--picture", f"{OUT}/groups.svg")))
    curve = desk.curve(message.curve)
    name = Path(curve.name.replace("/", "_")).stem.strip(".") or "curve"
    return Action("fit", (("--pipeline", f"{OUT}/{SETTINGS}"), ("--out", f"{OUT}/figures/{name}")), curve.file)


async def _output(action: Action, desk: Desk) -> str:
    """What a command prints, in a process of its own that executes only plugin files that were approved before.

    Raises ConfigurationError with what it says where it fails.
    """
    demand_allowed(action)
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-P", "-c", _COMMAND, " ".join(desk.folder.approved), *action.words(str(desk.path)),
        stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE,
    )  # fmt: skip
    out, errors = await process.communicate()
    if process.returncode == 2 or not out.strip():
        raise ConfigurationError(
            errors.decode(errors="replace").strip().removeprefix("palpate: ") or "the command failed"
        )
    return out.decode(errors="replace")
