"""How late the motion of a record stands behind its force, as far as the record alone says it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from palpate import ConfigurationError, Floats, to_si

_BANDS = (8.0, 12.0, 16.0, 25.0, 40.0)  # [Hz]
_LATEST = 0.05  # [s]
_EDGE = 0.4  # [s] at each end, which the low-pass bends


@dataclass(frozen=True)
class RecordDelay:
    """The delay of a record's motion, by the law of Kelvin and Voigt under a sphere.

    To first order the force of an oscillation contains the sum of delay and eta/G only; see docs/reproduce.md.
    """

    together: float  # [s] delay + eta/G
    least: float  # [s] the least delay of any band of frequencies, less its own standard uncertainty
    most: float  # [s] the greatest, more by its own; at most `together`, as a contact has a viscosity

    @property
    def delay(self) -> float:
        """The middle [s] of the two."""
        return (self.least + self.most) / 2

    @property
    def std(self) -> float:
        """Standard uncertainty [s]: every delay between them is alike."""
        return (self.most - self.least) / math.sqrt(12)


def record_delay(file: Path, pipeline: dict[str, Any]) -> RecordDelay:
    """The delay of a CSV record of a palpation with a sphere; raises ConfigurationError for another pipeline."""
    from scipy.interpolate import CubicSpline
    from scipy.signal import butter, sosfiltfilt

    try:
        device, alignment = pipeline["device"]["log"], pipeline["alignment"]
        columns = [device["columns"][name] for name in ("z", "f")]
        step, mass = 1.0 / to_si(device["rate"], "Hz"), to_si(alignment["tip_mass"], "kg")
    except KeyError as error:
        raise ConfigurationError(
            f"a delay is determined of device.log with columns z, f and rate: no {error}"
        ) from error
    table = np.loadtxt(file, delimiter=",", usecols=[column["column"] for column in columns])
    height = table[:, 0] * to_si(f"1 {columns[0]['unit']}", "m")
    force = table[:, 1] * to_si(f"1 {columns[1]['unit']}", "N")
    time: Floats = np.arange(len(height), dtype=np.float64) * step
    place = CubicSpline(time, sosfiltfilt(butter(4, _BANDS[-1], fs=1.0 / step, output="sos"), height))
    bands = [_of_band(place, time, force, mass, band) for band in _BANDS]
    together = float(np.median([late + viscous for late, viscous, _ in bands]))
    most = min(together, max(late + std for late, _, std in bands))
    return RecordDelay(together, min(most, *(late - std for late, _, std in bands)), most)


def _of_band(
    place: Callable[..., Floats], time: Floats, force: Floats, mass: float, band: float
) -> tuple[float, float, float]:
    """Delay, eta/G, and the standard uncertainty of either alone [s], with the least residual below a frequency.

    F = k (d^1.5 + 1.5 (eta/G) d^0.5 d') + m d'', the motion taken as much later as it was recorded.
    """
    from scipy.optimize import least_squares
    from scipy.signal import butter, sosfiltfilt

    sections = butter(4, band, fs=1.0 / (time[1] - time[0]), output="sos")
    edge = round(_EDGE / (time[1] - time[0]))
    rows = slice(edge, -edge)
    height = place(time)
    top, span = float(height.max()), float(np.ptp(height))

    def solved(unknown: Floats) -> tuple[Floats, Floats]:
        late = _LATEST * float(unknown[0])
        depth = np.maximum(top + span * float(unknown[1]) - place(time + late), 1e-6)
        felt = force + mass * place(time + late, 2)
        columns = np.column_stack([depth**1.5, -1.5 * np.sqrt(depth) * place(time + late, 1), felt])
        *laws, target = sosfiltfilt(sections, columns, axis=0)[rows].T
        size = [float(np.linalg.norm(law)) for law in laws]
        weights = np.linalg.lstsq(np.column_stack(laws) / size, target, rcond=None)[0] / size
        return weights, target - np.column_stack(laws) @ weights

    found = least_squares(lambda x: solved(x)[1], [0.0, 1.0], bounds=([-1.0, 0.0], [1.0, 20.0]), diff_step=1e-4)
    weights, left = solved(found.x)
    independent = 2.0 * band * (time[rows][-1] - time[rows][0])
    spread = np.linalg.inv(found.jac.T @ found.jac)[0, 0] * float(left @ left) / independent
    return _LATEST * float(found.x[0]), float(weights[1] / weights[0]), _LATEST * math.sqrt(spread)
