"""How far a wrong record is from the best that the right model makes of it, in standard deviations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from verdict_records.contact import FINE, Specimen
from verdict_records.rigs import Column
from verdict_records.wrongs import Wrong

DELAY = 0.2e-3  # [s] stated standard uncertainty between force and motion


@dataclass(frozen=True)
class Readings:
    """What a rig reads without noise, in fine steps."""

    time: Column  # (m,) [s]
    depth: Column  # (m,) [m] as it is logged
    force: Column  # (m,) [N]
    extra: Column | None = None  # (m,) [m] the deflection of a beam, logged next to the stage


def readings(s: Specimen, wrong: Wrong | None = None, size: float = 0.0) -> Readings:
    """The readings of a right record, or of one that is wrong by a size."""
    place = wrong.place if wrong else ""
    travel, none = s.travel, np.zeros(len(s.time))
    depth = wrong.change(s, size, travel, none) if wrong and place == "depth" else travel
    if wrong and wrong.name == "a base that gives":  # the size is a share of the way at the largest force
        depth = wrong.change(s, size * np.max(travel) / np.max(s.force(travel)), travel, none)
    elastic = s.elastic(depth)
    if wrong and place == "elastic":
        elastic = wrong.change(s, size, depth, elastic)
    contact = s.force(depth, elastic)
    if wrong and place == "contact":
        contact = wrong.change(s, size * np.max(contact) / 1e3, depth, contact)
    force = contact + s.rig.mass * s.rate_of(s.rate_of(travel))
    if wrong and place == "reading":
        scale = np.max(force) / 1e3 if wrong.most == 1e3 else 1.0
        force = wrong.change(s, size * scale, depth, force)
    logged = wrong.change(s, size, travel, contact) if wrong and place == "height" else travel
    if not (wrong and place == "cut"):
        extra = logged - travel if wrong and wrong.name == "stage and deflection" else None
        return Readings(s.time, logged, force, extra)
    begin = int(np.argmax(travel > size * np.max(travel)))
    return Readings(s.time[begin:], logged[begin:], force[begin:] - force[begin])


def sigmas(s: Specimen, wrong: Wrong, size: float) -> float:
    """Standard deviations by which the pattern stands out after projection on what is fitted and stated.

    Fitted: E, eta, height of the surface, and the zero of the force where the record has air. Stated: the delay, with
    its uncertainty. The noise of a sample is that of the force and of the motion by the force's slopes.
    """
    found = readings(s, wrong, size)
    d, rate = found.depth, np.gradient(found.depth, s.step)
    elastic = s.elastic(d)
    viscous = np.where(d > 0, 8 * s.radius(d) * rate, 0.0)
    model = np.where(d > 0, np.maximum(elastic + s.viscosity * viscous, 0.0), 0.0)
    model = model + s.rig.mass * np.gradient(rate, s.step)
    shift = 1e-4 * s.rig.depth
    by_depth = (s.elastic(d + shift) - s.elastic(d - shift)) / (2 * shift)
    by_rate = 8 * s.viscosity * s.radius(d)
    speed = s.rig.speed_noise or 0.0
    noise = np.sqrt(s.rig.noise**2 + (by_depth * s.rig.height_noise) ** 2 + (by_rate * speed) ** 2)
    columns = [elastic, viscous, by_depth, *([np.ones(len(d))] if wrong.place != "cut" else [])]
    stated = np.gradient(model, s.step) * DELAY
    return _left(found.force - model, columns, stated, noise)


def _left(pattern: Column, columns: list[Column], stated: Column, noise: Column) -> float:
    """Norm of a pattern (m,) over the noise, less what columns take of it, and one of standard uncertainty 1."""
    inside = slice(2 * FINE, -2 * FINE, FINE)
    fitted = np.column_stack([column[inside] / noise[inside] for column in columns])
    fitted = fitted / np.maximum(np.linalg.norm(fitted, axis=0), 1e-300)
    basis = np.linalg.qr(fitted[:, np.linalg.norm(fitted, axis=0) > 0])[0]

    def free(values: Column) -> Column:
        return np.asarray(values - basis @ (basis.T @ values))

    left, known = free(pattern[inside] / noise[inside]), free(stated[inside] / noise[inside])
    square = float(left @ left) - float(left @ known) ** 2 / (1.0 + float(known @ known))
    return float(np.sqrt(max(square, 0.0)))


def size_of(s: Specimen, wrong: Wrong, wanted: float) -> float | None:
    """The size whose pattern stands out by so many standard deviations; None where the largest does not."""
    low, high = 0.0, wrong.most * 1e-5
    while sigmas(s, wrong, high) < wanted:
        low, high = high, 2.0 * high
        if low >= wrong.most:
            return None
    for _ in range(20):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if sigmas(s, wrong, middle) > wanted else (middle, high)
    return min(high, wrong.most)
