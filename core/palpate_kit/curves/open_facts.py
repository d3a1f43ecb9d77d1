"""The facts that nobody has stated, as they are asked for: by the size of what another fact does to the values."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from palpate import Condition
from palpate_engine import TrackResult, UncertainValue, facts_stated

from palpate_kit.curves.curve_fits import named_values


@dataclass(frozen=True)
class OpenFact:
    """A key of ``rig.toml`` that is open, and what another fact would do."""

    key: str
    effect: str
    size: float = 0.0  # of the effect, as a part of the value that it moves most


WITHOUT_A_FIT = tuple(OpenFact(key, "it counts as open") for key in ("tip_mass", "tare", "delay", "thickness"))


def open_facts(track: TrackResult) -> list[OpenFact]:
    """The open facts of a track that a person can state, most effective first."""
    values, stating = named_values(track), facts_stated()
    conditions = {stating[one.fact]: one for one in track.conditions if one.fact in stating}
    found = [OpenFact(key, one.sentence(values), _size(one, values)) for key, one in conditions.items()]
    return sorted(found, key=lambda fact: -fact.size)


def _size(condition: Condition, values: Mapping[str, UncertainValue]) -> float:
    """How far an alternative moves a value, over the value or two of its uncertainties; the largest."""
    sizes: Iterable[float] = (
        abs(shift) / max(abs(value.value), 2 * value.combined, 1e-300)
        for name, shift in condition.shifts.items()
        if (value := values.get(name)) is not None
    )
    return max(sizes, default=0.0)
