"""The numbers behind every picture of a run: the readings, and the estimates of each track [SI]."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

from palpate_report.run_contents import RunContents

# Choices.
_WARM_UP = 1.0  # [s] from the first estimate, in which a filter is not judged
_WARM_UP_SHARE = 0.1  # of a short record, likewise
_MIN_MAP_EXTENT = 2e-3  # [m] of the places of a run, from which on they make a map
_MOTION_SPAN = 0.5  # [s] over which the speed of the tip is taken
_MIN_SPEED = 5e-4  # [m/s] of a tip that moves
_MAX_WIDTH_SHARE, _MAX_WIDTH = 0.1, 1e-4  # of the length of a way, and [m]: the width of one that counts as a line


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
        """True (n,) where used, without the first second of estimates, or the first tenth of fewer than ten seconds."""
        if not self.used.any():
            return self.used
        begin, end = self.time[self.used][[0, -1]].tolist()
        return np.asarray(self.used & (self.time >= begin + min(_WARM_UP, _WARM_UP_SHARE * (end - begin))))


def curves_of(record: RunContents, name: str) -> Curves:
    """Return the curves of one track of a run, with the force of the contact.

    That is the measured force, less the inertia of the tip, and less offset and drift that a fit has found.
    """
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
        # The drift [N/s] is about the middle of the samples that are used.
        begin, end = time[used][[0, -1]].tolist()
        contact = contact - fit.get("bias", 0.0) - fit.get("drift", 0.0) * (time - 0.5 * (begin + end))
    return Curves(
        name,
        time=time,
        place=track.place,
        depth=track.others["surface"] - measured["position"],
        force=contact,
        model=track.others["force"],
        values=track.values,
        std=track.std,
        innovation=track.others.get("innovation", np.full(len(time), np.nan)),
        used=used,
    )


def along(place: Floats) -> Floats | None:
    """Return the coordinate (n,) [m] along the line of places (n, 2), from its middle; None where they make an area."""
    is_finite = np.isfinite(place).all(axis=1)
    if is_finite.sum() < 2:
        return None
    # Principal axes of the places, the first of them along the larger of x and y.
    middle = 0.5 * (np.min(place[is_finite], axis=0) + np.max(place[is_finite], axis=0))
    _, _, axes = np.linalg.svd(place[is_finite] - middle, full_matrices=False)
    coordinates = (place - middle) @ axes.T
    length, width = np.ptp(coordinates[is_finite], axis=0)
    direction = 1.0 if axes[0][np.argmax(np.abs(axes[0]))] > 0 else -1.0
    return np.asarray(direction * coordinates[:, 0]) if width <= max(_MAX_WIDTH_SHARE * length, _MAX_WIDTH) else None


def swept(place: Floats) -> bool:
    """Return True if the places (n, 2) [m] of a run are far enough apart for a map."""
    finite_places = place[np.isfinite(place).all(axis=1)]
    return bool(len(finite_places) and np.ptp(finite_places, axis=0).max() > _MIN_MAP_EXTENT)


def moving_samples(time: Floats, place: Floats) -> NDArray[np.bool_]:
    """Return True (n,) where the tip moves over half a second, by its coordinates (n,) [m] along a line."""
    half = _MOTION_SPAN / 2
    distance = np.abs(np.interp(time + half, time, place) - np.interp(time - half, time, place))
    return np.asarray(distance > _MIN_SPEED * _MOTION_SPAN)


def thin_rows(count: int, max_rows: int) -> NDArray[np.intp]:
    """Return at most so many rows of `count`, evenly spread, with the first and the last."""
    if not count:
        return np.zeros(0, np.intp)
    return np.unique(np.linspace(0, count - 1, min(count, max_rows)).round().astype(np.intp))
