"""The suggestion of a pipeline from guessed roles: signs, tare, delay, doubts; the same for every kind of log."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from palpate import Floats, Indenter
from palpate_engine import AlignmentSettings, approved_plugins, registry, tip_table
from palpate_records.messages.readings import LARGEST
from palpate_records.recording import Suggestion

from palpate_kit.logs.delay_from_free_air import air_delay
from palpate_kit.logs.role_guess import ROLES, NumberColumn, Pick, RoleGuess, RoleSearch

# Choices.
_TARE_DURATION = 0.9  # [s] at the begin of a record
_AIR_SHARE = 0.15  # of a short record; a press from its first reading has 0.06 of its force by then
_MIN_TARE_READINGS = 12
_TARE_PARTS = 6  # of the first moments, whose means are compared
_MAX_WANDER = 1.5  # of the scatter within a part, up to which the means of parts scatter at rest
_MIN_WANDER = 0.01  # of the range of the force, below which a movement is too small to matter
_MAX_REST_SHARE = 0.05  # of the range of the force, up to which it is away from that of free air
_REST_SIGMAS = 3.0  # of the scatter of the means, in addition
_AIR_PERCENTILE = 0.5  # [%] of the forces, which is that of free air without spikes
_GAP_INTERVALS = 5.0  # usual intervals between readings that make a gap
_USUAL_RADIUS = 0.005  # [m] of a tip that is not stated, by which the plausibility of a unit is judged
_MIN_WAY = 0.04  # of the radius of the tip, that a palpation moves at least
_MIN_DEPTH = 2e-4  # of the radius of the tip, for a record that hardly moves
_LENGTHS = (("nm", 1e-9), ("um", 1e-6), ("mm", 1e-3), ("m", 1.0))  # a factor of 1000 apart
_FORCES = (("N", 1.0), ("mN", 1e-3), ("uN", 1e-6), ("nN", 1e-9))
_MAX_ELASTICITY, _MIN_ELASTICITY = 5e7, 50.0  # [Pa] beyond which another unit of force is likelier
_ELASTICITY_FACTOR = 0.375  # (1 - nu^2)/2 with nu = 0.5
_SI_UNITS = {"force": "N", "position": "m", "velocity": "m/s"}
TIP, UNITS = "tip", "units."  # choices that are not a role: the tip in words, the unit of a column
POSITION_OF = "position-of"  # a choice: "tip", or the "stage" behind a beam


def options(role: str, others: Sequence[NumberColumn]) -> str:
    """Return the options that would assign a role to each of the `others`, separated by commas."""
    return ", ".join(f"--{role} {column.label.removeprefix('column ')}" for column in others)


def doubtful_points(guess: RoleGuess) -> list[str]:
    """Return a sentence on each role and each sign that is not certain.

    `guess` has the columns that are likely force, position and velocity, and the signs by which they count.
    """
    doubts = []
    for role, pick in guess.picks.items():
        if not pick.sure:
            alternatives = f"; it could be {options(role, pick.others)}" if pick.others else ""
            doubts.append(f"{role}: {pick.series.label} is a guess ({pick.why}){alternatives}")
    unsure_roles = [role for role, sign in guess.signs.items() if not sign.sure]
    if "force" in unsure_roles:
        sign = guess.signs["force"]
        doubts.append(
            f"sign of the force: {sign.value:+d} is a guess ({sign.why}); if it is "
            "wrong, so are the signs of position and velocity"
        )
    elif unsure_roles:
        roles = " and ".join(unsure_roles)
        doubts.append(f"sign of {roles}: a guess, since the position explains little of the force")
    return doubts


def reasons_of(guess: RoleGuess) -> list[str]:
    """Return the reason for each role and its sign."""
    reasons = []
    for role, pick in guess.picks.items():
        sign = guess.signs[role]
        alternatives = f"; else {options(role, pick.others)}" if pick.others else ""
        reasons.append(f"{role}: {pick.series.label} ({pick.why}; sign {sign.value:+d}: {sign.why}{alternatives})")
    if "velocity" not in guess.picks:
        reasons.append("velocity: none is recorded; it is the derivative of the position")
    return reasons


def find_roles(series: Sequence[NumberColumn], chosen: Mapping[str, NumberColumn]) -> RoleGuess | None:
    """Return the roles of a log's numbers; None if none can be a force or a position."""
    return RoleSearch(series, chosen).best_guess()


def scale_column(pick: Pick, factor: float, sign: int) -> tuple[Floats, Floats]:
    """Return times [s] and values [SI] of a pick with its sign, without readings that are too large to be any."""
    is_reading = (np.abs(pick.series.values) < LARGEST) & np.isfinite(pick.series.time)
    return pick.series.time[is_reading], sign * factor * pick.series.values[is_reading]


def air_window(time: Floats) -> float:
    """Return the duration [s] of the air at the begin of a record: 0.9 s, and of a record below 6 s a share of 0.15.

    A curve of a microscope may last less than a second. It is at least as long as the fewest readings of a tare.
    """
    shortest = float(time[min(_MIN_TARE_READINGS, len(time)) - 1] - time[0])
    return max(min(_TARE_DURATION, _AIR_SHARE * float(time[-1] - time[0])), shortest)


def no_tare(time: Floats, force: Floats) -> str | None:
    """Return why the first moments of a force [N] over time [s] cannot be its tare; None if they can.

    There are too few readings, the force moves, or the tip touches already.
    """
    duration = air_window(time)
    window = force[time - time[0] <= duration]
    if len(window) < _MIN_TARE_READINGS:
        return f"there are too few readings in the first {duration:.3g} s"
    # The force moves if the means of parts scatter more than the readings within a part.
    parts = np.array_split(window, _TARE_PARTS)
    means = np.array([part.mean() for part in parts])
    scatter = float(means.std(ddof=1))
    scatter_within = float(np.mean([part.std() for part in parts]))
    # The range of the force without its noise: that of means over the length of a part.
    part_length = len(parts[0])
    smooth_force = np.convolve(force, np.ones(part_length) / part_length, "valid")
    span = float(np.ptp(smooth_force))
    if scatter > _MAX_WANDER * scatter_within and scatter > _MIN_WANDER * span:
        return f"the force moves in the first {duration:.3g} s"
    excess = float(window.mean() - np.percentile(smooth_force, _AIR_PERCENTILE))
    if excess > _MAX_REST_SHARE * span + _REST_SIGMAS * scatter:
        return f"the tip touches in the first {duration:.3g} s"
    return None


def tip_of(choices: Mapping[str, str]) -> Indenter | None:
    """Return the tip among choices, by which units are guessed; None without one."""
    return _build_tip(choices[TIP], frozenset(approved_plugins())) if TIP in choices else None


@lru_cache(1)
def _build_tip(text: str, plugins: frozenset[str]) -> Indenter:
    """Return the tip that a text describes; `plugins`, the approved ones, are only a key of the cache."""
    parts = registry.load()
    table = tip_table(text, parts)
    tip: Indenter = parts.find("indenter", table.pop("type"))(**table)  # type: ignore[assignment]
    return tip


def length_unit(span: float, tip: Indenter | None = None) -> str:
    """Return the likeliest unit of a position by its range: the smallest in which it is a palpation's way."""
    min_way = _MIN_WAY * _radius(tip)
    return next((unit for unit, factor in _LENGTHS if span * factor > min_way), "m")


def force_unit(force: float, way: float, tip: Indenter | None = None) -> tuple[str, float]:
    """Return the likeliest unit of a force by its range and the way [m], and the elasticity [Pa] that it would mean.

    F = 2 E A/(1 - nu^2) with the area A [m^2] of the tip's profile at that depth, and nu = 0.5. A unit is likely if the
    elasticity lies between those of soft materials; for none it is N.
    """
    depth = max(way, _MIN_DEPTH * _radius(tip))
    # The profile's area of a sphere is 2/3 sqrt(R) d^1.5 (Hertz 1881).
    area = 2 / 3 * _USUAL_RADIUS**0.5 * depth**1.5 if tip is None else float(tip.profile_area(depth))
    elasticity = _ELASTICITY_FACTOR * force / area
    if elasticity < _MIN_ELASTICITY:
        return "kN", elasticity * 1e3
    for unit, factor in _FORCES:
        if elasticity * factor <= _MAX_ELASTICITY:
            return unit, elasticity * factor
    return "N", elasticity


def _radius(tip: Indenter | None) -> float:
    """Return the radius of a tip [m], 5 mm without one."""
    radius = getattr(tip, "radius", None)
    return float(radius if isinstance(radius, float) else _USUAL_RADIUS)


def assemble_suggestion(
    guess: RoleGuess,
    device: Mapping[str, Any],
    channels: Mapping[str, str],
    factors: Mapping[str, float],
    extra: Mapping[str, Sequence[str]],
    seconds: float = 1.0,
) -> Suggestion:
    """Return the tables that read a log by guessed roles, with their reasons, doubts and blanks.

    `guess` has a column for each role, and its sign; `device` is the table of the device that reads the log. `channels`
    are those of the roles, `factors` SI per recorded unit, `extra` more reasons, doubts, blanks and hints, and
    `seconds` the length of the unit of time [s].
    """
    alignment: dict[str, Any] = {
        role: {"channel": channels[role], "sign": guess.signs[role].value} for role in ROLES if role in guess.picks
    }
    reasons = [*reasons_of(guess), *extra.get("reasons", ())]
    # Times [s] and values [SI] of the roles, by which tare, gap and delay are judged.
    series: dict[str, tuple[Floats, Floats]] = {}
    for role, pick in guess.picks.items():
        time, values = scale_column(pick, factors[role], guess.signs[role].value)
        series[role] = seconds * time, values
    alignment |= _alignment_of_series(series, reasons)
    return Suggestion(
        device,
        alignment,
        reasons=tuple(reasons),
        doubts=(*doubtful_points(guess), *extra.get("doubts", ())),
        blanks=tuple(extra.get("blanks", ())),
        hints=tuple(extra.get("hints", ())),
        views={role: (*numbers, _SI_UNITS[role]) for role, numbers in series.items()},
        rivals=_rival_columns(guess),
    )


def _alignment_of_series(series: Mapping[str, tuple[Floats, Floats]], reasons: list[str]) -> dict[str, Any]:
    """Return the keys of the alignment by times [s] and values [SI] of the roles; append the `reasons`."""
    alignment: dict[str, Any] = {"touch_force": "noise"}
    tare_duration = air_window(series["force"][0])
    if tare_duration > _TARE_DURATION:
        alignment["tare_duration"] = f"{tare_duration:.3g} s"
    if (pause := _pause(series.values())) is not None:
        alignment["gap"] = f"{pause:.2g} s"
        reasons.append(f"gap: readings come more slowly than usual, so that a pause is one of more than {pause:.2g} s")
    if (obstacle := no_tare(*series["force"])) is not None:
        alignment["tare"] = "none"
        reasons.append(f"tare: {obstacle}, which therefore gives none")
    return alignment


def _rival_columns(guess: RoleGuess) -> dict[str, tuple[str, ...]]:
    """Return the columns among which the user is asked to choose that of a role, by the roles that are not certain."""
    rivals = {}
    for role, pick in guess.picks.items():
        if not pick.sure and (pick.others or pick.series.is_guess):
            labels = [column.label for column in (pick.series, *pick.others)]
            rivals[role] = tuple(label.removeprefix("column ") for label in labels)
    return rivals


def _pause(series: Iterable[tuple[Floats, Floats]]) -> float | None:
    """Return the pause [s] between readings that is a gap; None if the default of the alignment will do."""
    intervals = [float(np.median(np.diff(time))) for time, _ in series if len(time) > 1]
    pause = _GAP_INTERVALS * max(intervals, default=0.0)
    return pause if pause > AlignmentSettings.model_fields["gap"].default else None


def delay_hint(suggestion: Suggestion) -> list[str]:
    """Return a sentence on the delay between force and motion in free air; in contact it cannot be determined.

    Empty for a suggestion without numbers of both.
    """
    if not {"force", "position"} <= suggestion.views.keys():
        return []
    estimate = air_delay(*suggestion.views["force"][:2], *suggestion.views["position"][:2])
    if estimate is None:
        return [
            "delay: nothing moves enough in free air to determine it; in contact it cannot be distinguished "
            "from viscosity"
        ]
    delay, std, mass = estimate
    late_role = "force" if delay > 0 else "position"
    return [
        f"delay: in free air the {late_role} is {abs(delay) * 1e3:.1f} +- {std * 1e3:.1f} ms late against the other, "
        f'by the inertia of {mass * 1e3:.0f} g; to declare it: {late_role}.delay = "{abs(delay) * 1e3:.1f} ms", '
        f'{late_role}.uncertainty = "{std * 1e3:.1f} ms"'
    ]
