"""Materiality: what counts against a value of a track beyond its uncertainty, and what it is worth by that."""

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

_OPEN = "undetermined"  # the note on a value that the record does not determine
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
_VISIBLE = 1e-3  # of a value: effects below are not listed


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
    """Return the one rule for every flag with an effect: doubtful only where it moves a value beyond its uncertainty.

    What a flag names is compared with the combined standard uncertainty of all other causes: a larger uncertainty by
    the flag's own cause makes no doubt smaller. Those whose effect is not known always count. A value that a flag voids
    is invalid by itself. A value within two uncertainties of none, or of an unknown one, is not determined; one that
    the alternative of an open fact moves by more than half needs that fact.
    """
    findings, immaterial = [], []
    doubts: dict[str, Verdict] = dict.fromkeys(values, "good")
    sizes: dict[int, float] = {}
    judged = registry.judged(flags)
    unknown = {name for flag in judged if flag.code == _OPEN for name in flag.effects or {}}
    for flag in (*judged, *registry.judged(_undetermined(unknown, values))):
        moved = _moved(flag, values)
        said = replace(_with_effects(flag, values), moves=moved if flag.severity != "note" else ())
        if flag.severity == "doubtful" and not moved:
            immaterial.append(said)
            continue
        sizes[id(said)] = _size(flag, values)
        findings.append(said)
        for name in moved if flag.severity != "note" else ():
            own: Verdict = "invalid" if _leaves_nothing(flag, name, registry) else flag.severity or "doubtful"
            doubts[name] = VERDICTS[max(VERDICTS.index(doubts[name]), VERDICTS.index(own))]
    findings.sort(key=lambda flag: (-VERDICTS.index(flag.severity or "doubtful"), -sizes[id(flag)]))
    # Without a rate a viscosity has no size, and what it needs is said before that it is not determined.
    timeless = {name for condition in conditions if condition.fact == "rate" for name in condition.shifts}
    open_values = {name for flag in findings if flag.code == _OPEN for name in flag.effects or {}} - timeless
    by_value = {
        name: _word(doubts[name], name in open_values, needs(conditions, name, value)) for name, value in values.items()
    }
    return WeighedFlags(tuple(findings), tuple(immaterial), by_value)


def _word(doubt: Verdict, is_open: bool, needed: str) -> str:
    """Return the verdict of a value: invalid before not determined, before what it needs, before doubtful."""
    if doubt == "invalid":
        return doubt
    if is_open:
        return NOT_DETERMINED
    return f"{NEEDS}{needed}" if needed else doubt


def _leaves_nothing(flag: Flag, name: str, registry: Registry) -> bool:
    """Return True if a flag says that a value is void, while others of its track may be used."""
    meaning = registry.meanings.get(flag.code)
    return meaning is not None and meaning.voids and math.isinf((flag.effects or {}).get(name, 0.0))


def _size(flag: Flag, values: Mapping[str, UncertainValue]) -> float:
    """By how many uncertainties a flag moves a value at most; what is not known comes first."""
    if flag.effects is None:
        return math.inf
    return max((_ratio(flag, name, values[name]) for name in flag.effects if name in values), default=0.0)


def _moved(flag: Flag, values: Mapping[str, UncertainValue]) -> tuple[str, ...]:
    """Names of the values that a flag puts in doubt."""
    if flag.effects is None:
        return tuple(values)
    if flag.severity == "invalid":
        return tuple(name for name in flag.effects if name in values)
    return tuple(name for name in flag.effects if name in values and _ratio(flag, name, values[name]) > 1.0)


def _ratio(flag: Flag, name: str, value: UncertainValue) -> float:
    """What a flag names over the standard uncertainty of everything else."""
    effect, others = (flag.effects or {})[name], value.without(*(flag.causes or ()))
    return effect / others if others > 0 else math.inf if effect > 0 else 0.0


def _undetermined(said: set[str], values: Mapping[str, UncertainValue]) -> Iterator[Flag]:
    """Yield the note on values that may be none as far as the record shows; nothing of what is said already."""
    for name, value in values.items():
        u = value.of_one_place
        if name in said or not math.isfinite(value.value):
            continue
        if value.unknown or math.isnan(u):
            yield Flag("undetermined", f"the uncertainty of {name} is not known", effects={name: math.inf})
        elif 2 * u > abs(value.value):
            rows = {"the estimator": value.std, "settling": value.settling, **value.budget}
            most = max((cause for cause in rows if cause != "places"), key=lambda cause: rows[cause])
            row = "noise" if most == "the estimator" else most.replace("_", "-")
            word, factor = display_unit(value.unit)
            size = f"{float(f'{factor * (abs(value.value) + 2 * u):.3g}'):g} {word}"
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
    """With its effects in words."""
    if not flag.effects or flag.code == _OPEN:
        return flag
    sizes = {name: size / abs(values[name].value or 1e-300) for name, size in flag.effects.items() if name in values}
    listed = [f"{name} by {_percent(size)}" for name, size in sizes.items() if size > _VISIBLE]
    return replace(flag, message=f"{flag.message}{EFFECTS}{', '.join(listed)}") if listed else flag


def _percent(share: float) -> str:
    if not math.isfinite(share):
        return "any amount"
    return f"{float(f'{100 * share:.2g}'):g} %" if share < 10 else "more than tenfold"
