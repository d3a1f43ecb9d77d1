"""Materiality: flags count against a value of a track where they move it beyond its uncertainty."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from palpate.evidence.condition import Condition, needs
from palpate.evidence.uncertain_value import UncertainValue
from palpate.flags import EFFECTS, NEEDS, NOT_DETERMINED, VERDICTS, Flag, Verdict
from palpate.registry import Registry
from palpate.units import display_unit

_UNDETERMINED = "undetermined"  # the note on a value that the record does not determine
# Rows of a budget in a sentence, by the name that a finding has as its cause.
_ROW_WORDS = {
    "model-discrepancy": "what the law leaves of the force",
    "noise": "the noise of the record",
    "settling": "what the estimate may still move",
    "poisson": "Poisson's ratio",
    "timing": "the time between force and motion",
    "tare": "the zero of the force",
    "mass": "the mass behind the sensor",
    "radius": "the radius of the tip",
}
_STATED = "state it with a smaller uncertainty"
# What makes such a row smaller.
_ROW_REMEDIES = dict.fromkeys(("poisson", "timing", "tare", "mass", "radius", "height", "beam"), _STATED) | {
    "model-discrepancy": "settle what is doubtful first, or compare laws (`palpate fit choose --help`)",
    "noise": "record for longer",
    "settling": "record for longer",
}
_PER_TIME = re.compile(r"\bs\b")  # in the unit of a viscosity
_COVERAGE_FACTOR = 2.0  # standard uncertainties from 0, within which a value is not determined: 95 % of normal noise
_MAX_LISTED = 10.0  # of a value: a larger effect is shown as "more than tenfold"; a choice
_MIN_LISTED = 1e-3  # of a value: effects below are not listed; a choice
_SMALLEST_VALUE = 1e-300  # in a quotient, in place of 0: near the smallest double


@dataclass(frozen=True)
class WeighedFlags:
    """The flags of a track by what they matter."""

    findings: tuple[Flag, ...]  # that matter, the worst and the largest first; notes last
    immaterial: tuple[Flag, ...]  # that can move no value beyond its uncertainty
    by_value: Mapping[str, str]  # verdicts


def weigh(
    flags: Sequence[Flag],
    values: Mapping[str, UncertainValue],
    registry: Registry,
    conditions: Sequence[Condition] = (),
) -> WeighedFlags:
    """Return the flags that matter and the verdicts of values, by one rule for every flag with an effect.

    A flag makes a value doubtful only where it moves it beyond its uncertainty. Its effect is compared with the
    combined standard uncertainty of all other causes: a larger uncertainty by the flag's own cause makes no doubt
    smaller. Flags whose effect is not known always count. A value that a flag voids is invalid by itself. A value
    within two uncertainties of zero, or of an unknown one, is not determined; one that the alternative of an open fact
    moves by more than half needs that fact.
    """
    # Flags, and notes on what the record does not determine.
    judged = registry.judged(flags)
    noted = _undetermined_values(judged)
    weighed = [_weighed(flag, values) for flag in (*judged, *registry.judged(_undetermined_flags(noted, values)))]
    # The worst and the largest first; the sort keeps the order of equals.
    findings = [finding for finding in weighed if finding.is_material]
    findings.sort(key=lambda finding: (-VERDICTS.index(finding.flag.severity or "doubtful"), -finding.largest_ratio))
    flags_by_size = tuple(finding.flag for finding in findings)

    # Without a rate a viscosity has no size: it needs the rate before it can be undetermined.
    undetermined = _undetermined_values(flags_by_size)
    undetermined -= {name for condition in conditions if condition.fact == "rate" for name in condition.shifts}
    doubts = _doubts(flags_by_size, values, registry)
    by_value = {}
    for name, value in values.items():
        by_value[name] = _verdict_of(doubts[name], name in undetermined, needs(conditions, name, value))
    return WeighedFlags(flags_by_size, tuple(finding.flag for finding in weighed if not finding.is_material), by_value)


@dataclass(frozen=True)
class _WeighedFlag:
    """A flag in words, with its size; a note moves no value."""

    flag: Flag
    largest_ratio: float  # of its effects, in uncertainties of a value
    is_material: bool  # False of a doubt that moves no value beyond its uncertainty


def _weighed(flag: Flag, values: Mapping[str, UncertainValue]) -> _WeighedFlag:
    """Return a flag with its effects in words, and the values that it moves."""
    ratio = _largest_ratio(flag, values)
    if flag.severity == "note":
        return _WeighedFlag(replace(_with_effects(flag, values), moves=()), ratio, is_material=True)
    moved = _moved_values(flag, values)
    is_material = flag.severity != "doubtful" or bool(moved)
    return _WeighedFlag(replace(_with_effects(flag, values), moves=moved), ratio, is_material)


def _doubts(findings: Sequence[Flag], values: Mapping[str, UncertainValue], registry: Registry) -> dict[str, Verdict]:
    """Return the worst severity of the flags that move each value, by name; good without any."""
    doubts: dict[str, Verdict] = dict.fromkeys(values, "good")
    for flag in findings:
        for name in flag.moves:
            severity: Verdict = "invalid" if _is_voided(flag, name, registry) else flag.severity or "doubtful"
            doubts[name] = VERDICTS[max(VERDICTS.index(doubts[name]), VERDICTS.index(severity))]
    return doubts


def _undetermined_values(flags: Sequence[Flag]) -> set[str]:
    """Return the names of the values that flags say the record does not determine."""
    return {name for flag in flags if flag.code == _UNDETERMINED for name in flag.effects or {}}


def _verdict_of(doubt: Verdict, is_undetermined: bool, needed: str) -> str:
    """Return the verdict of a value: invalid before not determined, before what it needs, before doubtful."""
    if doubt == "invalid":
        return doubt
    if is_undetermined:
        return NOT_DETERMINED
    return f"{NEEDS}{needed}" if needed else doubt


def _is_voided(flag: Flag, name: str, registry: Registry) -> bool:
    """Return True if a flag voids a value, while others of its track may be used."""
    meaning = registry.meanings.get(flag.code)
    return meaning is not None and meaning.voids and math.isinf((flag.effects or {}).get(name, 0.0))


def _largest_ratio(flag: Flag, values: Mapping[str, UncertainValue]) -> float:
    """Return the largest effect of a flag, in uncertainties of a value; infinite where its effects are not known."""
    if flag.effects is None:
        return math.inf
    return max((_ratio(flag, name, values[name]) for name in flag.effects if name in values), default=0.0)


def _moved_values(flag: Flag, values: Mapping[str, UncertainValue]) -> tuple[str, ...]:
    """Return the names of the values that a flag puts in doubt."""
    if flag.effects is None:
        return tuple(values)
    if flag.severity == "invalid":
        return tuple(name for name in flag.effects if name in values)
    return tuple(name for name in flag.effects if name in values and _ratio(flag, name, values[name]) > 1.0)


def _ratio(flag: Flag, name: str, value: UncertainValue) -> float:
    """Return the effect of a flag on a value over the standard uncertainty of all other causes."""
    effect, other_uncertainty = (flag.effects or {})[name], value.without(*(flag.causes or ()))
    if other_uncertainty > 0:
        return effect / other_uncertainty
    return math.inf if effect > 0 else 0.0


def _undetermined_flags(noted: set[str], values: Mapping[str, UncertainValue]) -> Iterator[Flag]:
    """Yield a note on values that may be zero as far as the record shows, unless they are `noted` already."""
    for name, value in values.items():
        u = value.of_one_place  # combined standard uncertainty; the places of a sweep may differ
        if name in noted or not math.isfinite(value.value):
            continue
        if value.unknown or math.isnan(u):
            yield Flag("undetermined", f"the uncertainty of {name} is not known", effects={name: math.inf})
        elif _COVERAGE_FACTOR * u > abs(value.value):
            rows = {"the estimator": value.std, "settling": value.settling, **value.budget}
            largest = max((cause for cause in rows if cause != "places"), key=lambda cause: rows[cause])
            row = "noise" if largest == "the estimator" else largest.replace("_", "-")
            unit, factor = display_unit(value.unit)
            size = f"{float(f'{factor * (abs(value.value) + _COVERAGE_FACTOR * u):.3g}'):g} {unit}"
            text = f"{name} is at most {size}; most of its ± is {row_words(row)}"
            yield Flag("undetermined", text, effects={name: u}, remedy=_row_remedy(row, value.unit), suspects=(row,))


def row_words(row: str) -> str:
    """Return a row of a budget in a sentence, by its name with hyphens."""
    return _ROW_WORDS.get(row, row.replace("-", " "))


def _row_remedy(row: str, unit: str) -> str:
    """Return what makes a value of a `unit` larger against this row of its budget, and the row smaller."""
    is_viscous = _PER_TIME.search(unit) is not None
    motion = "Press at two speeds or oscillate, in which a viscosity shows" if is_viscous else "Press deeper"
    return f"{'; '.join(filter(None, [motion, _ROW_REMEDIES.get(row)]))}."


def _with_effects(flag: Flag, values: Mapping[str, UncertainValue]) -> Flag:
    """Return a flag with its effects in words."""
    if not flag.effects or flag.code == _UNDETERMINED:
        return flag
    sizes = {
        name: size / abs(values[name].value or _SMALLEST_VALUE) for name, size in flag.effects.items() if name in values
    }
    listed = [f"{name} by {_percent(size)}" for name, size in sizes.items() if size > _MIN_LISTED]
    return replace(flag, message=f"{flag.message}{EFFECTS}{', '.join(listed)}") if listed else flag


def _percent(share: float) -> str:
    """Return a share in words, to two digits."""
    if not math.isfinite(share):
        return "any amount"
    return f"{float(f'{100 * share:.2g}'):g} %" if share < _MAX_LISTED else "more than tenfold"
