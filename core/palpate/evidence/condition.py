"""Conditions: facts that the record cannot show and nobody has stated, and what a value would be with another fact."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from palpate.evidence.uncertain_value import UncertainValue, finite_tree

# Codes of flags of older versions, and the fact that is a condition in their place.
FORMER_FLAGS = {
    "assumed": "the key that was assumed",
    "thickness-undeclared": "thickness",
    "tare-undeclared": "tare",
    "commanded-motion": "position",
    "one-frequency": "frequency",
    "not-distinguishable-from-delay": "delay",
}
_NEEDED = 0.5  # of a value, or of its interval of two standard uncertainties, that an alternative moves


@dataclass(frozen=True)
class Condition:
    """An open fact, which never makes a doubt: the values hold if it is as assumed."""

    fact: str  # one of the facts of docs/verdict.md, such as "thickness"
    text: str  # what is assumed, as in "holds if: ..."
    remedy: str  # the words that state the fact
    alternative: str = ""  # with which the shifts are, as in "22 mm"; empty: none, and no value needs the fact
    shifts: Mapping[str, float] = field(default_factory=dict)  # [SI] of each value by the alternative, with signs
    code: str = ""  # of the flag by which older versions said it

    def matters(self, values: Mapping[str, UncertainValue]) -> bool:
        """Whether the alternative moves any value by its uncertainty; one without an alternative always does."""
        moved = ((abs(shift), values[name].combined) for name, shift in self.shifts.items() if name in values)
        return not self.alternative or any(not size < u for size, u in moved if size > 0)

    def needed_by(self, name: str, value: UncertainValue) -> bool:
        """Whether the alternative moves a value by more than half of it, or of two standard uncertainties."""
        size, u = abs(self.shifts.get(name, 0.0)), value.combined
        return bool(self.alternative) and size > _NEEDED * max(abs(value.value), 0.0 if math.isnan(u) else 2 * u)

    def sentence(self, values: Mapping[str, UncertainValue]) -> str:
        """The assumption, and the relative change of each value if the alternative were true.

        Values that change by less than their combined uncertainty are left out.

        >>> thick = Condition("thickness", "specimen thicker than 49 mm", "--thickness", "22 mm", {"elasticity": -6.5})
        >>> thick.sentence({"elasticity": UncertainValue(50.0, 1.0, "Pa")})
        'specimen thicker than 49 mm (22 mm: elasticity 13 % lower)'
        """
        said = [
            f"{name} {_share(shift / value.value)} {'higher' if shift * value.value > 0 else 'lower'}"
            for name, shift in self.shifts.items()
            if (value := values.get(name)) is not None and value.value and value.combined <= abs(shift) < math.inf
        ]
        return f"{self.text} ({self.alternative}: {', '.join(said)})" if said and self.alternative else self.text

    def table(self, values: Mapping[str, UncertainValue]) -> dict[str, Any]:
        """As in ``result.json``."""
        table = {
            "fact": self.fact,
            "message": self.sentence(values),
            "remedy": self.remedy,
            "alternative": self.alternative,
            "shifts": finite_tree(dict(self.shifts)),
            "needed_by": [name for name, value in values.items() if self.needed_by(name, value)],
        }
        return table | ({"code": self.code} if self.code else {})


def _share(share: float) -> str:
    return f"{float(f'{100 * abs(share):.2g}'):g} %" if abs(share) < 10 else "more than tenfold"


def needs(conditions: Iterable[Condition], name: str, value: UncertainValue) -> str:
    """The fact that a value needs most; empty where it needs none."""
    needed = [one for one in conditions if one.needed_by(name, value)]
    return max(needed, key=lambda one: abs(one.shifts[name])).fact if needed else ""


def joined(conditions: Sequence[Condition]) -> tuple[Condition, ...]:
    """One condition for each fact, the first that names it."""
    return tuple({one.fact: one for one in reversed(conditions)}.values())[::-1]
