"""The result of a run on a reference as a check for the chart: value, tip, sensor and robot."""

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

_REPEAT_TERMS = ("std", "settling", "systematic_tare")  # of the uncertainty, that differ from run to run


@dataclass(frozen=True)
class RunCheck:
    """A run on a reference."""

    track: str
    tip: dict[str, Any]
    sensor: dict[str, str]
    robot: dict[str, str]
    check: RecordedCheck


def check_of_run(path: Path, reference: Reference, track: str | None) -> RunCheck:
    """Return the check that a run folder holds, of one track or the best; raises UserError where it holds none.

    `repeat_std` of the check is the part of its combined uncertainty that differs from run to run.
    """
    folder = RunFolder(path)
    if not folder.finished:
        raise LogError(f"{path}: is not a run folder with a {RESULT}")
    document = folder.result
    name = _track(path, document["tracks"], reference, track)
    value = values_by_name(document["tracks"][name])[reference.quantity]
    repeat_std = math.hypot(*(value.get(term) or 0.0 for term in _REPEAT_TERMS))
    pipeline = _pipeline(folder)
    return RunCheck(
        track=name,
        tip=_tip(pipeline, document["tracks"][name]["model"]),
        sensor=_device(pipeline, document["run"], "force"),
        robot=_device(pipeline, document["run"], "position"),
        check=RecordedCheck(
            date=datetime.fromisoformat(document["run"]["started"]),
            run=str(path),
            digest=hashlib.sha256((path / RESULT).read_bytes()).hexdigest(),
            value=value["value"],
            std=value["combined"],
            repeat_std=min(repeat_std, value["combined"]),
        ),
    )


def _track(path: Path, tracks: Mapping[str, Any], reference: Reference, name: str | None) -> str:
    """Return the track of a name, or the best of those that have the value; raises ConfigurationError without any.

    The best has the best verdict, and of these the smallest uncertainty.
    """
    if name is not None and name not in tracks:
        raise ConfigurationError(f"{path}: no track {name!r}{suggest(name, tracks)}")
    candidates = tracks if name is None else {name: tracks[name]}
    tracks_with_value = {
        label: table for label, table in candidates.items() if reference.quantity in values_by_name(table)
    }
    if not tracks_with_value:
        spring = '; a spring is palpated with [model.*] type = "kelvin-voigt"' if reference.unit == "N/m" else ""
        raise ConfigurationError(f"{path}: has no {reference.quantity} to compare with {reference.name!r}{spring}")
    ranks = {label: verdict_rank(table["verdict"]) for label, table in tracks_with_value.items()}
    usable = [label for label, rank in ranks.items() if rank <= verdict_rank("doubtful")]
    if not usable:
        labels = ", ".join(tracks_with_value)
        raise ConfigurationError(f"{path}: {labels} is invalid, and checks nothing; see its flags")
    uncertainties: dict[str, float] = {}
    for label in usable:
        if uncertainty := values_by_name(tracks_with_value[label])[reference.quantity].get("combined"):
            uncertainties[label] = float(uncertainty)
    if not uncertainties:
        raise ConfigurationError(f"{path}: the uncertainty of {reference.quantity} is not known, so it checks nothing")
    return min(uncertainties, key=lambda label: (ranks[label], uncertainties[label]))


def _pipeline(folder: RunFolder) -> dict[str, Any]:
    """Return the tables of the pipeline as run [SI]; raises LogError."""
    try:
        return toml_tables(bounded_text(folder.pipeline))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise LogError(f"{folder.pipeline}: cannot be read: {error}") from error


def _tip(pipeline: Mapping[str, Any], model: str) -> dict[str, Any]:
    """Return the tip of a model, named or written out; the only one of the pipeline where the model states none."""
    tip = pipeline.get("model", {}).get(model, {}).get("indenter")
    tips = pipeline.get("indenter", {})
    if isinstance(tip, str):
        return dict(tips[tip])
    return dict(tip or (next(iter(tips.values())) if len(tips) == 1 else {}))


def _device(pipeline: Mapping[str, Any], run: Mapping[str, Any], role: str) -> dict[str, str]:
    """Return the identity of the device from which force or position are read."""
    device = str(pipeline.get("alignment", {}).get(role, {}).get("channel", "")).partition(".")[0]
    prefix = f"{device}."
    facts = {key.removeprefix(prefix): text for key, text in run["inputs"].items() if key.startswith(prefix)}
    facts |= run.get("live", {}).get("devices", {}).get(device, {})
    return {key: text for key, text in facts.items() if isinstance(text, str) and is_identity(key)}
