"""Quantities of a material by a run, with their uncertainty and the conditions under which they were measured."""

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

_STRAIN_FACTOR = 0.2  # representative strain over a/R below a sphere (Tabor 1951)
_INCOMPRESSIBLE = 0.5  # Poisson's ratio of a model that states none


@dataclass(frozen=True)
class Conditions:
    """Rate and amount of the deformation of a material [SI]; None where one is not known."""

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
    """Return quantities of one track of a run, the stated or the best one, in their order.

    Raises UserError where no track has them, or only tracks that are invalid or without uncertainty.
    """
    folder = RunFolder(path)
    if not folder.finished:
        raise LogError(f"{path}: is not a run folder with a {RESULT}")
    tracks = folder.result["tracks"]
    if track is not None and track not in tracks:
        raise ConfigurationError(f"{path}: no track {track!r}{suggest(track, tracks)}")
    allowed_tracks = tracks if track is None else {track: tracks[track]}
    name, values = _best_track(path, allowed_tracks, quantities)

    # The conditions are those of the pipeline, by the model of the track.
    model = folder.settings.get("model", {}).get(tracks[name]["model"], {})
    started = datetime.fromisoformat(folder.result["run"]["started"])
    poisson = float(model.get("poisson", _INCOMPRESSIBLE))
    conditions = conditions_of(folder.settings, model)
    return [
        RunValue(
            str(path),
            name,
            value=float(value["value"]),
            std=float(value["combined"]),
            unit=value["unit"],
            verdict=tracks[name]["verdict"],
            started=started,
            poisson=poisson,
            conditions=conditions,
        )
        for value in (values[quantity] for quantity in quantities)
    ]


def _best_track(path: Path, tracks: Mapping[str, Any], quantities: tuple[str, ...]) -> tuple[str, Mapping[str, Any]]:
    """Return the track with the best verdict, then the smallest uncertainty, and its values by name.

    Raises ConfigurationError where no track has all quantities, each with an uncertainty.
    """
    values = {name: values_by_name(table) for name, table in tracks.items()}
    complete = {name: track_values for name, track_values in values.items() if set(quantities) <= track_values.keys()}
    if not complete:
        raise ConfigurationError(f"{path}: no track has {' and '.join(quantities)} to compare")
    usable = {}
    for name, track_values in complete.items():
        is_valid = verdict_rank(tracks[name]["verdict"]) <= verdict_rank("doubtful")
        if is_valid and all(track_values[quantity].get("combined") for quantity in quantities):
            usable[name] = track_values
    if not usable:
        raise ConfigurationError(f"{path}: {', '.join(complete)} is invalid or without uncertainty; see its flags")

    def rank(name: str) -> tuple[int, Any]:
        return verdict_rank(tracks[name]["verdict"]), usable[name][quantities[0]]["combined"]

    best = min(usable, key=rank)
    return best, usable[best]


def conditions_of(settings: Mapping[str, Any], model: Mapping[str, Any]) -> Conditions:
    """Return frequency, representative strain and speed of a run's motion, as its pipeline states them.

    A sine of amplitude A has the largest speed 2 pi f A; the strain below a sphere of radius R at a depth d is
    0.2 sqrt(d/R) (Tabor 1951). Nothing is known of several trajectories.
    """
    motions = [motion for motion in settings.get("trajectory", {}).values() if isinstance(motion, dict)]
    motion = motions[0] if len(motions) == 1 else {}
    frequency, depth, speed = (motion.get(key) for key in ("frequency", "bias", "speed"))
    amplitude = motion.get("amplitude")
    if frequency and amplitude and speed is None:
        speed = 2.0 * math.pi * float(frequency) * float(amplitude)
    radius = _sphere_radius(settings.get("indenter", {}), model)
    strain = _STRAIN_FACTOR * math.sqrt(float(depth) / float(radius)) if depth and radius else None
    return Conditions(
        frequency=None if frequency is None else float(frequency),
        strain=None if strain is None else float(strain),
        speed=None if speed is None else float(speed),
    )


def _sphere_radius(tips: Mapping[str, Any], model: Mapping[str, Any]) -> Any:
    """Return the radius [m] of a model's tip, named, written within the model, or the first; None if not a sphere."""
    indenter = model.get("indenter")
    tip = tips.get(indenter, {}) if isinstance(indenter, str) else indenter or next(iter(tips.values()), {})
    return tip.get("radius") if isinstance(tip, dict) and is_ball(tip, registry.load()) else None
