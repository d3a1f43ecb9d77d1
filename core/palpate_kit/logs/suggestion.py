"""A suggestion out of what was found: signs, tare, delay, doubts; the same for every kind of log."""

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
from palpate_kit.logs.role_guess import ROLES, NumberColumn, Pick, RoleGuess, Search

_TARE = 0.9  # [s]
_AIR_SHARE = 0.15  # of a short record; a press from its first reading has 0.06 of its force by then
_FEWEST = 12  # readings
_PARTS, _WANDER = 6, 1.5  # of those first moments; of the scatter within a part, that their means have at rest
_FREE = 0.05  # of the force's range by which its rest may be away from where it touches nothing
_STEPS = 5.0  # usual intervals that make a gap
_RADIUS = 0.005  # [m] of the tip by which a unit's plausibility is judged
_LEAST = 0.04  # of that radius, the least way of a palpation
_LENGTHS = (("nm", 1e-9), ("um", 1e-6), ("mm", 1e-3), ("m", 1.0))  # a factor of 1000 apart
_FORCES = (("N", 1.0), ("mN", 1e-3), ("uN", 1e-6), ("nN", 1e-9))
TIP, UNITS = "tip", "units."  # choices that are not a role: the tip in words, the unit of a column
POSITION_OF = "position-of"  # a choice: "tip", or the "stage" behind a beam
_STIFFEST, _SOFTEST = 5e7, 50.0  # [Pa] beyond which another unit of force is likelier


def options(role: str, others: Sequence[NumberColumn]) -> str:
    """Options of the command line that would assign a role to each of the `others`, separated by commas."""
    return ", ".join(f"--{role} {s.label.removeprefix('column ')}" for s in others)


def doubtful_points(found: RoleGuess) -> list[str]:
    """What is not certain about the roles and their signs, in words."""
    said = []
    for role, pick in found.picks.items():
        if not pick.sure:
            others = f"; it could be {options(role, pick.others)}" if pick.others else ""
            said.append(f"{role}: {pick.series.label} is a guess ({pick.why}){others}")
    unsure = [role for role, sign in found.signs.items() if not sign.sure]
    if "force" in unsure:
        said.append(
            f"sign of the force: {found.signs['force'].value:+d} is a guess ({found.signs['force'].why}); if it is "
            "wrong, so are the signs of position and velocity"
        )
    elif unsure:
        named = " and ".join(unsure)
        said.append(f"sign of {named}: a guess, since the position explains little of the force")
    return said


def reasons_of(found: RoleGuess) -> list[str]:
    """Return why each role was chosen, and which way it counts."""
    said = []
    for role, pick in found.picks.items():
        sign = found.signs[role]
        others = f"; else {options(role, pick.others)}" if pick.others else ""
        said.append(f"{role}: {pick.series.label} ({pick.why}; sign {sign.value:+d}: {sign.why}{others})")
    if "velocity" not in found.picks:
        said.append("velocity: none is recorded; it is the derivative of the position")
    return said


def find_roles(series: Sequence[NumberColumn], chosen: Mapping[str, NumberColumn]) -> RoleGuess | None:
    """Return the roles of a log's numbers."""
    return Search(series, chosen).found()


def scale_column(pick: Pick, factor: float, sign: int) -> tuple[Floats, Floats]:
    """Times [s] and values [SI], as they count."""
    good = (np.abs(pick.series.values) < LARGEST) & np.isfinite(pick.series.time)
    return pick.series.time[good], sign * factor * pick.series.values[good]


def air_window(time: Floats) -> float:
    """How long [s] the air at the begin of a record is looked at: for 0.9 s, or as many readings as say anything.

    A curve of a microscope may last less: of a record of 6 s or less the first 0.15.
    """
    first = float(time[min(_FEWEST, len(time)) - 1] - time[0])
    return max(min(_TARE, _AIR_SHARE * float(time[-1] - time[0])), first)


def no_tare(time: Floats, force: Floats) -> str | None:
    """Return why the first moments give no tare: the force moves, or the tip touches already; None where they do."""
    seconds = air_window(time)
    window = force[time - time[0] <= seconds]
    if len(window) < _FEWEST:
        return f"there are too few readings in the first {seconds:.3g} s"
    parts = np.array_split(window, _PARTS)
    means, within = np.array([part.mean() for part in parts]), float(np.mean([part.std() for part in parts]))
    reach = len(parts[0])
    course = np.convolve(force, np.ones(reach) / reach, "valid")  # without its noise
    span, scatter = float(np.ptp(course)), float(means.std(ddof=1))
    if scatter > _WANDER * within and scatter > 0.01 * span:
        return f"the force moves in the first {seconds:.3g} s"
    if float(window.mean() - np.percentile(course, 0.5)) > _FREE * span + 3.0 * scatter:
        return f"the tip touches in the first {seconds:.3g} s"
    return None


def tip_of(choices: Mapping[str, str]) -> Indenter | None:
    """Return the tip among choices, by which units are guessed; None without any."""
    return _tip(choices[TIP], frozenset(approved_plugins())) if TIP in choices else None


@lru_cache(1)
def _tip(text: str, plugins: frozenset[str]) -> Indenter:
    """Return the tip of a text, whose kind may be of one of these plugins."""
    known = registry.load()
    table = tip_table(text, known)
    found: Indenter = known.find("indenter", table.pop("type"))(**table)  # type: ignore[assignment]
    return found


def length_unit(span: float, tip: Indenter | None = None) -> str:
    """Return the likeliest unit of a position by how far it moves, which is more than a twenty-fifth of the tip's
    radius."""
    least = _LEAST * _radius(tip)
    return next((unit for unit, factor in _LENGTHS if span * factor > least), "m")


def force_unit(force: float, way: float, tip: Indenter | None = None) -> tuple[str, float]:
    """Return the likeliest unit of a force by its range and the way [m], and the elasticity [Pa] that it would mean.

    F = 2 E A/(1 - nu^2) with the area A of the tip's profile at that depth, and nu = 0.5.
    """
    depth = max(way, 2e-4 * _radius(tip))
    area = 2 / 3 * _RADIUS**0.5 * depth**1.5 if tip is None else float(tip.profile_area(depth))
    elasticity = 0.375 * force / area
    if elasticity < _SOFTEST:
        return "kN", elasticity * 1e3
    for unit, factor in _FORCES:
        if elasticity * factor <= _STIFFEST:
            return unit, elasticity * factor
    return "N", elasticity


def _radius(tip: Indenter | None) -> float:
    """Return the size of a tip [m]: its radius, 5 mm where it has none."""
    found = getattr(tip, "radius", None) if tip is not None else _RADIUS
    return float(found if isinstance(found, float) else _RADIUS)


def assemble_suggestion(
    found: RoleGuess,
    device: Mapping[str, Any],
    channels: Mapping[str, str],
    factors: Mapping[str, float],
    extra: Mapping[str, Sequence[str]],
    seconds: float = 1.0,
) -> Suggestion:
    """Return the tables and the words.

    `factors` are SI per recorded unit, `extra` more reasons, doubts and blanks, `seconds` how long the unit of time is.
    """
    alignment: dict[str, Any] = {
        role: {"channel": channels[role], "sign": found.signs[role].value} for role in ROLES if role in found.picks
    }
    reasons = [*reasons_of(found), *extra.get("reasons", ())]
    raw = {r: scale_column(found.picks[r], factors[r], found.signs[r].value) for r in found.picks}
    series = {r: (seconds * time, values) for r, (time, values) in raw.items()}
    alignment["touch_force"] = "noise"
    seconds = air_window(series["force"][0])
    if seconds > _TARE:
        alignment["tare_duration"] = f"{seconds:.3g} s"
    if (pause := _pause(series.values())) is not None:
        alignment["gap"] = f"{pause:.2g} s"
        reasons.append(f"gap: readings come more slowly than usual, so that a pause is one of more than {pause:.2g} s")
    why = no_tare(*series["force"])
    if why is not None:
        alignment["tare"] = "none"
        reasons.append(f"tare: {why}, which therefore gives none")
    views = {r: (*series[r], {"force": "N", "position": "m", "velocity": "m/s"}[r]) for r in series}
    doubts = (*doubtful_points(found), *extra.get("doubts", ()))
    asked = {r: p for r, p in found.picks.items() if not p.sure and (p.others or p.series.is_guess)}
    labels = {r: [s.label for s in (p.series, *p.others)] for r, p in asked.items()}
    rivals = {role: tuple(label.removeprefix("column ") for label in names) for role, names in labels.items()}
    blanks = tuple(extra.get("blanks", ()))
    return Suggestion(
        device, alignment, tuple(reasons), doubts, blanks, tuple(extra.get("hints", ())), views, rivals=rivals
    )


def _pause(series: Iterable[tuple[Floats, Floats]]) -> float | None:
    """Return the pause [s] between readings that is a gap, where that of a robot's logs is not; else None."""
    steps = [float(np.median(np.diff(time))) for time, _ in series if len(time) > 1]
    longest = _STEPS * max(steps, default=0.0)
    return longest if longest > AlignmentSettings.model_fields["gap"].default else None


def delay_hint(suggestion: Suggestion) -> list[str]:
    """Return the delay between force and motion, where something swings in free air; in contact it cannot be
    determined. Empty for a suggestion without numbers of both."""
    if not {"force", "position"} <= suggestion.views.keys():
        return []
    found = air_delay(*suggestion.views["force"][:2], *suggestion.views["position"][:2])
    if found is None:
        return [
            "delay: nothing moves enough in free air to determine it; in contact it cannot be distinguished "
            "from viscosity"
        ]
    delay, std, mass = found
    late = "force" if delay > 0 else "position"
    return [
        f"delay: in free air the {late} is {abs(delay) * 1e3:.1f} +- {std * 1e3:.1f} ms late against the other, by the "
        f'inertia of {mass * 1e3:.0f} g; to declare it: {late}.delay = "{abs(delay) * 1e3:.1f} ms", '
        f'{late}.uncertainty = "{std * 1e3:.1f} ms"'
    ]
