"""What a run has measured of a material, with its uncertainty and the conditions under which it was measured."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from palpate import ConfigurationError, LogError, suggest
from palpate_engine import RESULT, is_ball, registry, verdict_rank
from palpate_kit.runs.result_file import values_by_name
from palpate_kit.runs.run_folder import RunFolder

_REPRESENTATIVE = 0.2  # strain over a/R below a sphere


@dataclass(frozen=True)
class Conditions:
    """How fast and how far a material was deformed [SI]; None where it is not known."""

    frequency: float | None = None  # [Hz]
    strain: float | None = None
    speed: float | None = None  # [m/s]


@dataclass(frozen=True)
class RunValue:
    """One quantity of a run."""

    run: str
    track: str
    value: float
    std: float
    unit: str
    verdict: str
    started: datetime
    poisson: float
    conditions: Conditions


def run_values(path: Path, quantities: tuple[str, ...], track: str | None) -> list[RunValue]:
    """Quantities of one track of a run, the stated or the best; raises UserError where it has none, or not usable."""
    folder = RunFolder(path)
    if not folder.finished:
        raise LogError(f"{path}: is not a run folder with a {RESULT}")
    tracks = folder.result["tracks"]
    if track is not None and track not in tracks:
        raise ConfigurationError(f"{path}: no track {track!r}{suggest(track, tracks)}")
    among = tracks if track is None else {track: tracks[track]}
    values = {name: values_by_name(table) for name, table in among.items()}
    having = {name: found for name, found in values.items() if set(quantities) <= found.keys()}
    if not having:
        raise ConfigurationError(f"{path}: no track has {' and '.join(quantities)} to compare")
    usable = {
        name: values
        for name, values in having.items()
        if verdict_rank(tracks[name]["verdict"]) <= verdict_rank("doubtful")
        and all(values[one].get("combined") for one in quantities)
    }
    if not usable:
        raise ConfigurationError(f"{path}: {', '.join(having)} is invalid or without uncertainty; see its flags")
    name = min(usable, key=lambda one: (verdict_rank(tracks[one]["verdict"]), usable[one][quantities[0]]["combined"]))
    model = folder.settings.get("model", {}).get(tracks[name]["model"], {})
    started = datetime.fromisoformat(folder.result["run"]["started"])
    poisson, conditions = float(model.get("poisson", 0.5)), conditions_of(folder.settings, model)
    return [
        RunValue(
            str(path), name, float(found["value"]), float(found["combined"]), found["unit"],
            tracks[name]["verdict"], started, poisson, conditions,
        )
        for found in (usable[name][one] for one in quantities)
    ]  # fmt: skip


def conditions_of(settings: Mapping[str, Any], model: Mapping[str, Any]) -> Conditions:
    """Frequency, representative strain and speed of a run's motion, as its pipeline states them."""
    motions = [one for one in settings.get("trajectory", {}).values() if isinstance(one, dict)]
    motion = motions[0] if len(motions) == 1 else {}
    frequency, depth, speed = (motion.get(key) for key in ("frequency", "bias", "speed"))
    amplitude = motion.get("amplitude")
    if frequency and amplitude and speed is None:
        speed = 2.0 * math.pi * float(frequency) * float(amplitude)
    indenter = model.get("indenter")
    tips = settings.get("indenter", {})
    tip = tips.get(indenter, {}) if isinstance(indenter, str) else indenter or next(iter(tips.values()), {})
    radius = tip.get("radius") if isinstance(tip, dict) and is_ball(tip, registry.load()) else None
    strain = _REPRESENTATIVE * math.sqrt(float(depth) / float(radius)) if depth and radius else None
    return Conditions(*(None if one is None else float(one) for one in (frequency, strain, speed)))
