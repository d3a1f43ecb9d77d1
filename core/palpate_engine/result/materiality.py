"""Materiality: which failed assumptions can move a value of a track beyond its uncertainty, and are a doubt."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from palpate.evidence.uncertain_value import UncertainValue
from palpate.flags import VERDICTS, Flag, Verdict
from palpate.registry import Registry

WIDE = 0.2  # of a value: a larger uncertainty is a doubt by itself
_VISIBLE = 1e-3  # of a value: effects below are not listed


@dataclass(frozen=True)
class WeighedFlags:
    """The flags of a track by what they matter."""

    findings: tuple[Flag, ...]  # that matter, the worst and the largest first; notes last
    immaterial: tuple[Flag, ...]  # that can move no value beyond its uncertainty
    by_value: Mapping[str, Verdict]


def weigh(flags: Sequence[Flag], values: Mapping[str, UncertainValue], registry: Registry) -> WeighedFlags:
    """The one rule for every flag with an effect: doubtful only where it moves a value beyond its uncertainty.

    What a flag names is compared with the combined standard uncertainty of all other causes: a larger uncertainty by
    the flag's own cause makes no doubt smaller. Structural flags, and those whose effect is not known, always count. An
    uncertainty of more than 20 % of a value is a doubt of that value. A value that a flag voids is
    invalid by itself.
    """
    findings, immaterial = [], []
    by_value: dict[str, Verdict] = dict.fromkeys(values, "good")
    sizes: dict[int, float] = {}
    judged = registry.judged(flags)
    for flag in (*judged, *registry.judged(_wide(judged, values))):
        said = _with_effects(flag, values)
        moved = _moved(flag, values, registry)
        if flag.severity == "doubtful" and not moved:
            immaterial.append(said)
            continue
        sizes[id(said)] = _size(flag, values)
        findings.append(said)
        for name in moved if flag.severity != "note" else ():
            own: Verdict = "invalid" if _leaves_nothing(flag, name, registry) else flag.severity or "doubtful"
            by_value[name] = VERDICTS[max(VERDICTS.index(by_value[name]), VERDICTS.index(own))]
    findings.sort(key=lambda flag: (-VERDICTS.index(flag.severity or "doubtful"), -sizes[id(flag)]))
    return WeighedFlags(tuple(findings), tuple(immaterial), by_value)


def _leaves_nothing(flag: Flag, name: str, registry: Registry) -> bool:
    """Whether a flag says that a value is none, while others of its track may be used."""
    meaning = registry.meanings.get(flag.code)
    return meaning is not None and meaning.voids and math.isinf((flag.effects or {}).get(name, 0.0))


def _size(flag: Flag, values: Mapping[str, UncertainValue]) -> float:
    """By how many uncertainties a flag moves a value at most; what is not known comes first."""
    if flag.effects is None:
        return math.inf
    return max((_ratio(flag, name, values[name]) for name in flag.effects if name in values), default=0.0)


def _moved(flag: Flag, values: Mapping[str, UncertainValue], registry: Registry) -> tuple[str, ...]:
    """Names of the values that a flag puts in doubt."""
    if flag.effects is None:
        return tuple(values)
    meaning = registry.meanings.get(flag.code)
    if meaning is None or meaning.structural or flag.severity == "invalid":
        return tuple(name for name in flag.effects if name in values)
    return tuple(name for name in flag.effects if name in values and _ratio(flag, name, values[name]) > 1.0)


def _ratio(flag: Flag, name: str, value: UncertainValue) -> float:
    """What a flag names over the standard uncertainty of everything else."""
    effect, others = (flag.effects or {})[name], value.without(*flag.causes)
    return effect / others if others > 0 else math.inf if effect > 0 else 0.0


def _wide(flags: Sequence[Flag], values: Mapping[str, UncertainValue]) -> Iterator[Flag]:
    """The doubt on values that are hardly known; nothing of what a flag calls invalid or undetermined already."""
    said = {name for flag in flags if flag.code == "undetermined" for name in flag.effects or values}
    wide = {
        name: value
        for name, value in values.items()
        if name not in said and not value.unknown and value.of_one_place > WIDE * abs(value.value)
    }
    for name, value in values.items():
        bounded = not any(math.isinf((flag.effects or {}).get(name, 0.0)) for flag in flags)
        if (
            name not in said
            and bounded
            and (value.unknown or math.isnan(value.combined))
            and math.isfinite(value.value)
        ):
            yield Flag("undetermined", f"the uncertainty of {name} is not known", effects={name: math.inf})
    for name, value in wide.items():
        rows = {"the estimator": value.std, "settling": value.settling, **value.budget}
        most = max((cause for cause in rows if cause != "places"), key=lambda cause: rows[cause])
        if any(
            most in flag.causes and name in (flag.effects or {}) and _ratio(flag, name, value) > 1 for flag in flags
        ):
            continue  # which says so already
        share = 100 * value.of_one_place / abs(value.value) if value.value else math.inf
        known = f"{float(f'{share:.2g}'):g} %" if share < 1000 else "more than tenfold"
        text = f"{name} is known to {known} only, mostly for {most.replace('_', ' ')}"
        yield Flag("undetermined", text, effects={name: value.of_one_place})


def _with_effects(flag: Flag, values: Mapping[str, UncertainValue]) -> Flag:
    """With its effects in words."""
    if not flag.effects or flag.code == "undetermined":
        return flag
    sizes = {name: size / abs(values[name].value or 1e-300) for name, size in flag.effects.items() if name in values}
    listed = [f"{name} by {_percent(size)}" for name, size in sizes.items() if size > _VISIBLE]
    return replace(flag, message=f"{flag.message}; can move {', '.join(listed)}") if listed else flag


def _percent(share: float) -> str:
    if not math.isfinite(share):
        return "any amount"
    return f"{float(f'{100 * share:.2g}'):g} %" if share < 10 else "more than tenfold"
