"""The picture of a calibration: the force of a shake, and the inertia by mass, delay and motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from palpate_kit.figures import figure_of, legend_outside, save_figure, style

from palpate_calibration.calibration_record import CalibrationRecord
from palpate_calibration.motion_segments import shake_segments
from palpate_calibration.protocol import StepFindings
from palpate_calibration.sines import sine_fit

_WIDTH, _PANEL_HEIGHT = 120.0, 40.0  # [mm]: choices
_SPAN = 0.5  # [s] of the shake that is drawn: a choice


@style()
def draw(record: CalibrationRecord, findings: StepFindings, settle: float, path: Path) -> None:
    """Draw half a second of force in the first shake, -m z'' with and without the delay, and the residual.

    `settle` [s] of the shake's beginning are left out.
    """
    shake, segment = findings.shakes[0], shake_segments(record, settle)[0]
    middle = (segment.begin + segment.end) / 2
    motion = sine_fit(*record.position.between(segment.begin, segment.end), shake.frequencies, middle)
    time, force = record.force.between(segment.begin, segment.begin + _SPAN)
    omega = 2 * np.pi * np.array(shake.frequencies)

    def inertia(delay: float) -> np.ndarray:
        """Return mass times acceleration (n,) [N], by the fitted sines of the height, later by a delay [s]."""
        turns = np.exp(1j * np.outer(time - middle - delay, omega))
        return np.asarray((turns * (findings.values["mass"].value * omega**2 * motion.phasors)).sum(axis=1).real)

    tau = findings.values["delay"].value
    level = force - shake.offset
    figure, axes = figure_of(1, 2, width=_WIDTH, height=_PANEL_HEIGHT)
    upper, lower = axes[:, 0]  # the forces, and what each inertia leaves of the measured one
    milliseconds = 1e3 * (time - time[0])
    upper.plot(milliseconds, level, ".", markersize=2, color="0.5", label="force less its mean")
    upper.set_prop_cycle(None)
    upper.plot(milliseconds, inertia(tau), label=f"mass times acceleration, {tau * 1e3:.2f} ms later")
    upper.plot(milliseconds, inertia(0.0), label="the same as stamped")
    upper.set_ylabel("force [N]")
    legend_outside(upper, 2)
    lower.plot(milliseconds, level - inertia(tau))
    lower.plot(milliseconds, level - inertia(0.0))
    lower.set(xlabel="time [ms]", ylabel="left over [N]")
    save_figure(figure, path)
