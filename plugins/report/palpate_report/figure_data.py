"""The numbers behind every picture of a run: what was measured, and what each track makes of it [SI]."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

from palpate_report.run_contents import RunContents

_WARM = 1.0  # [s] from its first estimate in which a filter finds its feet
_SWEPT = 2e-3  # [m] from which on the places of a run make a map
_LOOK = 0.5  # [s] over which it is decided whether the tip moves
_SLOW = 5e-4  # [m/s]; below it stands
_LINE = 0.1  # of the length of a way, below which its width makes it a line


@dataclass(frozen=True)
class Curves:
    """One track over time; (n,) each, NaN where nothing is known."""

    name: str
    time: Floats  # [s]
    place: Floats  # (n, 2) [m]
    depth: Floats  # [m] below the surface that the track finds
    force: Floats  # [N] of the contact: measured, less inertia of the tip and what a fit takes for offset and drift
    model: Floats  # [N] of the model at the estimate
    values: Mapping[str, Floats]
    std: Mapping[str, Floats]
    innovation: Floats  # over its own standard deviation
    used: NDArray[np.bool_]  # there is an estimate that the track stands by

    @property
    def residual(self) -> Floats:
        """Measured less model [N]."""
        return self.force - self.model

    @property
    def settled(self) -> NDArray[np.bool_]:
        """What is used, without the first second of estimates, or the first tenth of fewer than ten seconds."""
        if not self.used.any():
            return self.used
        begin, end = self.time[self.used][[0, -1]].tolist()
        return np.asarray(self.used & (self.time >= begin + min(_WARM, 0.1 * (end - begin))))


def curves_of(record: RunContents, name: str) -> Curves:
    """Return the curves of one track of a run."""
    table, track = record.tracks[name]
    measured = table.measured
    time, force = measured["time"], measured["force"]
    with np.errstate(divide="ignore", invalid="ignore"):
        acceleration = np.gradient(measured["velocity"], time) if len(time) > 2 else np.full(len(time), np.nan)
    # Height and depth count in opposite directions: F = u + m z''.
    contact = force + record.tip_mass * np.nan_to_num(acceleration)
    fit = record.document.get("tracks", {}).get(name, {}).get("fit", {})
    used = track.usable & np.isfinite(track.others["force"])
    if fit and used.any():
        begin, end = time[used][[0, -1]].tolist()
        contact = contact - fit.get("bias", 0.0) - fit.get("drift", 0.0) * (time - 0.5 * (begin + end))
    return Curves(
        name,
        time,
        track.place,
        track.others["surface"] - measured["position"],
        contact,
        track.others["force"],
        track.values,
        track.std,
        track.others.get("innovation", np.full(len(time), np.nan)),
        used,
    )


def along(place: Floats) -> Floats | None:
    """Coordinate (n,) [m] along the line on which places (n, 2) lie, from its middle; None where they make an area."""
    known = np.isfinite(place).all(axis=1)
    if known.sum() < 2:
        return None
    middle = 0.5 * (np.min(place[known], axis=0) + np.max(place[known], axis=0))
    _, _, axes = np.linalg.svd(place[known] - middle, full_matrices=False)
    turned = (place - middle) @ axes.T
    length, width = np.ptp(turned[known], axis=0)
    direction = 1.0 if axes[0][np.argmax(np.abs(axes[0]))] > 0 else -1.0
    return np.asarray(direction * turned[:, 0]) if width <= max(_LINE * length, 1e-4) else None


def swept(place: Floats) -> bool:
    """Return True if the places (n, 2) [m] of a run are far enough apart for a map."""
    known = place[np.isfinite(place).all(axis=1)]
    return bool(len(known) and np.ptp(known, axis=0).max() > _SWEPT)


def moving_samples(time: Floats, place: Floats) -> NDArray[np.bool_]:
    """(n,) Whether the tip is on its way at coordinates (n,) [m] along a line: it moves over half a second."""
    apart = np.abs(np.interp(time + _LOOK / 2, time, place) - np.interp(time - _LOOK / 2, time, place))
    return np.asarray(apart > _SLOW * _LOOK)


def thin_rows(count: int, most: int) -> NDArray[np.intp]:
    """At most `most` rows of `count`, evenly spread, with the first and the last."""
    return (
        np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(np.intp))
        if count
        else np.zeros(0, np.intp)
    )
