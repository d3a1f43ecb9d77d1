"""Facts of a run in words: its origin, its truth, and the alignment with tare and first touch."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from palpate_engine import display_unit
from palpate_kit.terminal.quantities import number_with_unit

from palpate_report.number_texts import number_text, plain, readable
from palpate_report.run_contents import RunContents

_FACTS = {  # of `run` in the result: what they are called, and their unit
    "started": ("started", ""),
    "log_duration": ("length of the record", "s"),
    "samples": ("samples", ""),
    "duration": ("computing time", "s"),
    "seed": ("seed", ""),
    "pipeline": ("pipeline", ""),
    "command": ("command", ""),
    "host": ("host", ""),
}
_TIP_UNITS = {  # of keys of [alignment] that are one number
    "tip_mass": "kg",
    "tip_mass_uncertainty": "kg",
    "tare_uncertainty": "N",
    "series_stiffness": "N/m",
}


def origin_facts(run: Mapping[str, Any]) -> dict[str, str]:
    """Return when, from which record and by which command a run was made, by name."""
    facts = {}
    for key, (name, unit) in _FACTS.items():
        value = run.get(key)
        if value is not None:
            facts[name] = f"{value:.4g} {unit}" if unit else plain(value)
    return facts


def true_values(document: Mapping[str, Any]) -> list[str]:
    """Return the true values of a simulated rig, in the units of the tracks."""
    units: dict[str, str] = {}
    for table in document.get("tracks", {}).values():
        units |= {name: value["unit"] for name, value in table["parameters"].items()}
    units["surface"] = "m"
    truth = document.get("truth", {})
    return [
        f"{readable(name)} {number_with_unit(value, units[name], digits=5)}"
        for name, value in truth.items()
        if name in units
    ]


def calibration_facts(document: Mapping[str, Any], record: RunContents) -> dict[str, Any]:
    """Return the facts of the alignment: sources and delays of force and motion, mass, tare, first touch."""
    alignment, run = record.resolved.get("alignment", {}), record.resolved.get("run", {})
    measured = document.get("run", {})
    rows: dict[str, Any] = {**_signal_facts(alignment), **_tip_facts(alignment)}
    if tare := measured.get("tare"):
        rows |= _tare_facts(tare)
    if touch := measured.get("first_touch"):
        height = number_text(touch["position"], "m")
        rows["first touch"] = f"{touch['time']:.3f} s, at {height} ({plain(touch.get('by'))})"
    calibration = run.get("calibration")
    rows["calibration file"] = plain(calibration) if calibration else "none"
    if uncertainties := run.get("uncertainties"):
        rows["declared uncertainties"] = plain(uncertainties)
    return rows


def _signal_facts(alignment: Mapping[str, Any]) -> dict[str, str]:
    """Return channel and delay of force, position and velocity, of those that [alignment] names."""
    rows = {}
    for name in ("force", "position", "velocity"):
        signal = alignment.get(name)
        if isinstance(signal, dict):
            uncertainty = signal.get("uncertainty")
            spread = "not declared" if uncertainty is None else f"± {number_text(uncertainty, 's')}"
            delay = number_text(signal.get("delay", 0.0), "s")
            rows[f"{name} from"] = f"{signal.get('channel')}, delay {delay} ({spread})"
    return rows


def _tip_facts(alignment: Mapping[str, Any]) -> dict[str, str]:
    """Return mass, tare's uncertainty and stiffness in series, of those that [alignment] states as numbers."""
    rows = {}
    for key, unit in _TIP_UNITS.items():
        if isinstance(alignment.get(key), int | float):
            rows[readable(key)] = number_text(alignment[key], unit)
    return rows


def _tare_facts(tare: Mapping[str, Any]) -> dict[str, str]:
    """Return the offset that was subtracted from the force, and the noise of the force in the air."""
    rows = {}
    offset, std = tare.get("offset"), tare.get("std")
    if offset is not None:
        symbol, factor = display_unit("N")
        spread = f" ± {number_text(std, 'N')}" if std else ""
        rows["tare"] = f"{offset * factor:.4g} {symbol}{spread}"
    if tare.get("noise") is not None:
        rows["noise of one force sample"] = number_text(tare["noise"], "N")
    return rows
