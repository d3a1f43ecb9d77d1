"""What a run on a reference found: its value, tip and sensor, as a check for the chart."""

from __future__ import annotations

import hashlib
import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from palpate import ConfigurationError, LogError, suggest
from palpate_engine import RESULT, bounded_text, toml_tables, verdict_rank
from palpate_kit.runs.device_identity import is_identity
from palpate_kit.runs.result_file import values_by_name
from palpate_kit.runs.run_folder import RunFolder

from palpate_control.chart_file import RecordedCheck
from palpate_control.reference import Reference

_REPEAT = ("std", "settling", "systematic_tare")  # what differs from run to run


@dataclass(frozen=True)
class RunCheck:
    """A run on a reference."""

    track: str
    tip: dict[str, Any]
    sensor: dict[str, str]
    robot: dict[str, str]
    check: RecordedCheck


def check_of_run(path: Path, reference: Reference, track: str | None) -> RunCheck:
    """Return the check that a run folder holds, of one track or the best; raises UserError where it holds none."""
    folder = RunFolder(path)
    if not folder.finished:
        raise LogError(f"{path}: is not a run folder with a {RESULT}")
    document = folder.result
    name = _track(path, document["tracks"], reference, track)
    found = values_by_name(document["tracks"][name])[reference.quantity]
    pipeline = _pipeline(folder)
    return RunCheck(
        name,
        _tip(pipeline, document["tracks"][name]["model"]),
        _device(pipeline, document["run"], "force"),
        _device(pipeline, document["run"], "position"),
        RecordedCheck(
            date=datetime.fromisoformat(document["run"]["started"]),
            run=str(path),
            digest=hashlib.sha256((path / RESULT).read_bytes()).hexdigest(),
            value=found["value"],
            std=found["combined"],
            repeat_std=min(math.hypot(*(found.get(key) or 0.0 for key in _REPEAT)), found["combined"]),
        ),
    )


def _track(path: Path, tracks: Mapping[str, Any], reference: Reference, wanted: str | None) -> str:
    """Return the track of a name, or the best of those that have the value; raises ConfigurationError where none
    has."""
    if wanted is not None and wanted not in tracks:
        raise ConfigurationError(f"{path}: no track {wanted!r}{suggest(wanted, tracks)}")
    among = tracks if wanted is None else {wanted: tracks[wanted]}
    having = {name: table for name, table in among.items() if reference.quantity in values_by_name(table)}
    if not having:
        spring = '; a spring is palpated with [model.*] type = "kelvin-voigt"' if reference.unit == "N/m" else ""
        raise ConfigurationError(f"{path}: has no {reference.quantity} to compare with {reference.name!r}{spring}")
    usable = {
        name: table for name, table in having.items() if verdict_rank(table["verdict"]) <= verdict_rank("doubtful")
    }
    if not usable:
        raise ConfigurationError(f"{path}: {', '.join(having)} is invalid, and checks nothing; see its flags")
    known = {name: table for name, table in usable.items() if values_by_name(table)[reference.quantity].get("combined")}
    if not known:
        raise ConfigurationError(f"{path}: the uncertainty of {reference.quantity} is not known, so it checks nothing")
    return min(known, key=lambda name: (verdict_rank(known[name]["verdict"]), _width(known[name], reference)))


def _width(table: Mapping[str, Any], reference: Reference) -> float:
    return float(values_by_name(table)[reference.quantity]["combined"])


def _pipeline(folder: RunFolder) -> dict[str, Any]:
    """Return the tables of the pipeline as run [SI]; raises LogError."""
    try:
        return toml_tables(bounded_text(folder.pipeline))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise LogError(f"{folder.pipeline}: cannot be read: {error}") from error


def _tip(pipeline: Mapping[str, Any], model: str) -> dict[str, Any]:
    """Return the tip of a model, named or written out; the only one of the pipeline where the model states none."""
    stated = pipeline.get("model", {}).get(model, {}).get("indenter")
    tips = pipeline.get("indenter", {})
    if isinstance(stated, str):
        return dict(tips[stated])
    return dict(stated or (next(iter(tips.values())) if len(tips) == 1 else {}))


def _device(pipeline: Mapping[str, Any], run: Mapping[str, Any], role: str) -> dict[str, str]:
    """What identifies the device that force or position are read from."""
    device = str(pipeline.get("alignment", {}).get(role, {}).get("channel", "")).partition(".")[0]
    stated = {
        key.removeprefix(f"{device}."): text for key, text in run["inputs"].items() if key.startswith(f"{device}.")
    }
    stated |= run.get("live", {}).get("devices", {}).get(device, {})
    return {key: text for key, text in stated.items() if isinstance(text, str) and is_identity(key)}
