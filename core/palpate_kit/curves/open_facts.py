"""The facts that nobody has stated, as they are asked for: by the size of what another fact does to the values.

A fact is asked for where a condition names it, and where a finding does.
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
    """A key of ``rig.toml`` that is open, and what another fact would do."""

    key: str
    effect: str
    size: float = 0.0  # of the effect, as a part of the value that it moves most


WITHOUT_A_FIT = tuple(OpenFact(key, "it counts as open") for key in ("tip_mass", "tare", "delay", "thickness"))


def open_facts(tracks: Iterable[TrackResult]) -> list[OpenFact]:
    """Return the open facts of tracks that a person can state, each once, most effective first."""
    largest: dict[str, OpenFact] = {}
    for track in tracks:
        for fact in (*_of_findings(track), *_of_conditions(track)):
            if fact.key not in largest or fact.size > largest[fact.key].size:
                largest[fact.key] = fact
    return sorted(largest.values(), key=lambda fact: -fact.size)


def _of_conditions(track: TrackResult) -> Iterator[OpenFact]:
    values, stating = named_values(track), facts_stated()
    for one in track.conditions:
        if one.fact in stating:
            yield OpenFact(stating[one.fact], with_symbols(one.sentence(values)), _size(one, values))


def _of_findings(track: TrackResult) -> Iterator[OpenFact]:
    """Yield the facts by which findings can be settled; a fact of which the record shows a sign comes before others."""
    options = {option_of(key): key for key in facts_stated().values()}
    for finding in track_row(track, "").judging_findings:
        key = options.get(finding.remedy.partition(" ")[0])
        if key is not None:
            size = max((size for size in finding.sizes.values() if size is not None), default=0.0)
            yield OpenFact(key, with_symbols(finding.sentence.partition("; ")[0]), 1.0 + size)


def _size(condition: Condition, values: Mapping[str, UncertainValue]) -> float:
    """Return how far an alternative moves a value, over the value or two of its uncertainties; the largest."""
    sizes: Iterable[float] = (
        abs(shift) / max(abs(value.value), 2 * value.combined, 1e-300)
        for name, shift in condition.shifts.items()
        if (value := values.get(name)) is not None
    )
    return max(sizes, default=0.0)
