"""A viscosity that an oscillation with one frequency cannot distinguish from a stiffness that fades fast."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from palpate import Diagnosed, TrackEvidence
from palpate_engine import display_unit
from palpate_kit.budget.force_sensitivity import along

from palpate_uncertainty.delay.delay_from_motion import one_line
from palpate_uncertainty.delay.timing_shift import delay_shifts, is_viscous
from palpate_uncertainty.whiteness import oscillation

# Choices: how much may fade without a law that says so, and what of it is worth a note.
FADING = 0.1  # of the stiffness: "a tenth" in the sentence
_MIN_SHARE = 0.1  # of a viscosity


def one_frequency(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Of every track on an oscillation with one frequency: what a tenth of fading stiffness would be of its viscosity.

    A part g of the stiffness that fades within tau loses g K w tau/(1 + w^2 tau^2) of force per depth at the angular
    frequency w, g K/2 at most, at tau = 1/w: as a delay of g/(2 w) does. It leaves no residual: the viscosity is that
    at this frequency, and only another one distinguishes the two. Models that have a memory are left out.
    """
    tables = {
        track.name: _fading_table(track) for track in tracks if track.ending is not None and not track.model.memory
    }
    return {name: Diagnosed(table=table) for name, table in tables.items() if table}


def one_frequency_text(track: TrackEvidence) -> str:
    """Return a sentence on a viscosity that was measured at one frequency alone; empty where that does not matter.

    At one frequency a stiffness that relaxes looks like a viscosity. The sentence says how much of a viscosity may be a
    tenth of the stiffness that relaxes, if that is more than a tenth of the viscosity.
    """
    table = _fading_table(track) if track.ending is not None and not track.model.memory else {}
    if not table or not one_line(track):
        return ""
    values = dict(zip((parameter.name for parameter in track.model.parameters), track.values.tolist(), strict=True))
    parts = [
        f"{like['value']:.3g} of the {values[name]:.3g} {display_unit(like['unit'])[0]} of {name}"
        for name, like in table["looks_like"].items()
        if like["value"] > _MIN_SHARE * abs(values[name])
    ]
    milliseconds = float(f"{1e3 * table['time']:.2g}")
    within = f"if a tenth of the stiffness relaxed within {milliseconds:g} ms, that would be"
    return f"one frequency only ({table['frequency']:.3g} Hz): {within} {', '.join(parts)}" if parts else ""


def _fading_table(track: TrackEvidence) -> Mapping[str, Any]:
    """Return `frequency` [Hz], `time` [s] of a relaxation, and what it `looks_like`; empty for other motions.

    A part g of the stiffness that relaxes with the time constant 1/w, w the angular frequency of the motion, looks like
    a delay of the force of g/(2 w), and with any other one like less. That delay shifts a viscosity by
    d(theta)/d(delay) g/(2 w), which `looks_like` has by parameter.
    """
    end, used = track.ending, track.kept.used & np.isfinite(track.kept.position)
    viscous = [parameter for parameter in track.model.parameters if is_viscous(parameter)]
    if end is None or not viscous or not np.isfinite(track.values).all():
        return {}
    rhythm = oscillation(track.kept.time[used], track.kept.position[used])
    if rhythm is None:
        return {}
    # The shift of each viscosity by the delay g/(2 w).
    frequency, _ = rhythm
    angular_frequency = 2.0 * np.pi * frequency
    shifts = delay_shifts(track.model, along(track.model, end.tail, end.last, track.values, end.held), track.values)
    like = {
        parameter.name: {"value": abs(float(shift)) * FADING / (2.0 * angular_frequency), "unit": parameter.unit}
        for parameter, shift in zip(track.model.parameters, shifts, strict=True)
        if is_viscous(parameter) and shift and np.isfinite(shift)
    }
    if not like:
        return {}
    return {"frequency": frequency, "fading": FADING, "time": 1.0 / angular_frequency, "looks_like": like}
