"""The picture of a calibration: a shake's force, and what mass and delay make of its motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from palpate_calibration.protocol import StepFindings
from palpate_calibration.record import CalibrationRecord
from palpate_calibration.segments import shaking
from palpate_calibration.sines import sine_fit

_SHOWN = 0.5  # [s]


def draw(record: CalibrationRecord, session: StepFindings, settle: float, path: Path) -> None:
    """Half a second of force in the first shake, -m z'' with and without the delay, and what is left over."""
    from matplotlib.figure import Figure

    shake, segment = session.shakes[0], shaking(record, settle)[0]
    middle = (segment.begin + segment.end) / 2
    motion = sine_fit(*record.position.between(segment.begin, segment.end), shake.frequencies, middle)
    time, force = record.force.between(segment.begin, segment.begin + _SHOWN)
    omega = 2 * np.pi * np.array(shake.frequencies)

    def inertia(delay: float) -> np.ndarray:
        turns = np.exp(1j * np.outer(time - middle - delay, omega))
        return np.asarray((turns * (session.values["mass"].value * omega**2 * motion.phasors)).sum(axis=1).real)

    tau = session.values["delay"].value
    level = force - shake.offset
    figure = Figure(figsize=(8.0, 5.0), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    shown = 1e3 * (time - time[0])
    upper.plot(shown, level, ".", markersize=3, color="0.5", label="force less its mean")
    upper.plot(shown, inertia(0.0), "--", color="C1", label="mass times acceleration, as stamped")
    upper.plot(shown, inertia(tau), color="C0", label=f"the same, {tau * 1e3:.2f} ms later")
    upper.set_ylabel("force [N]")
    figure.legend(fontsize=8, loc="outside upper center", ncols=3)
    lower.plot(shown, level - inertia(0.0), "--", color="C1", linewidth=0.8)
    lower.plot(shown, level - inertia(tau), color="C0", linewidth=0.8)
    lower.set(xlabel="time [ms]", ylabel="left over [N]")
    figure.savefig(path, dpi=150)
