"""The facts that nobody has stated, in the order of the effect that another fact would have on the values.

A fact is open if a condition or the remedy of a finding names it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from palpate import Condition
from palpate_engine import TrackResult, UncertainValue, facts_stated, option_of

from palpate_kit.curves.curve_fits import named_values
from palpate_kit.terminal.result_table import track_row, with_symbols


@dataclass(frozen=True)
class OpenFact:
    """A key of ``rig.toml`` that is not stated, and the effect of another fact on the values."""

    key: str
    effect: str
    size: float = 0.0  # of the effect, relative to the value that it moves most


_FINDING_PRIORITY = 1.0  # added to the size for a finding: the record shows a sign of the fact; a choice
_SMALLEST = 1e-300  # in a quotient, in place of 0: near the smallest double
# The facts of curves that are not fitted yet.
WITHOUT_A_FIT = tuple(OpenFact(key, "it counts as open") for key in ("tip_mass", "tare", "delay", "thickness"))


def open_facts(tracks: Iterable[TrackResult]) -> list[OpenFact]:
    """Return the open facts of tracks that a person can state, each once, most effective first."""
    largest: dict[str, OpenFact] = {}
    for track in tracks:
        for fact in (*_facts_of_findings(track), *_facts_of_conditions(track)):
            if fact.key not in largest or fact.size > largest[fact.key].size:
                largest[fact.key] = fact
    return sorted(largest.values(), key=lambda fact: -fact.size)


def _facts_of_conditions(track: TrackResult) -> Iterator[OpenFact]:
    """Yield the facts on whose assumption values of a track depend."""
    values = named_values(track)
    keys = facts_stated()
    for condition in track.conditions:
        if condition.fact in keys:
            effect = with_symbols(condition.sentence(values))
            yield OpenFact(keys[condition.fact], effect, _relative_effect(condition, values))


def _facts_of_findings(track: TrackResult) -> Iterator[OpenFact]:
    """Yield the facts that the remedies of findings ask for; these come before those of conditions."""
    options = {option_of(key): key for key in facts_stated().values()}
    for finding in track_row(track, "").judging_findings:
        key = options.get(finding.remedy.partition(" ")[0])
        if key is not None:
            size = max((size for size in finding.sizes.values() if size is not None), default=0.0)
            yield OpenFact(key, with_symbols(finding.sentence.partition("; ")[0]), _FINDING_PRIORITY + size)


def _relative_effect(condition: Condition, values: Mapping[str, UncertainValue]) -> float:
    """Return the largest shift of a value by another fact, relative to the value.

    Relative to two of its uncertainties where these are larger: a value near zero would make any shift large.
    """
    relative_shifts: Iterable[float] = (
        abs(shift) / max(abs(value.value), 2 * value.combined, _SMALLEST)
        for name, shift in condition.shifts.items()
        if (value := values.get(name)) is not None
    )
    return max(relative_shifts, default=0.0)
