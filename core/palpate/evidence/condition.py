"""Conditions: facts that no record shows and nobody has stated, and the shift of a value by another fact."""

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
_MAX_SHIFT = 0.5  # of a value, or of its interval of two standard uncertainties, a choice: a larger one needs the fact
_MAX_SHARE = 10.0  # a choice: a share beyond it, 1000 %, is shown as "more than tenfold"
_PERCENT = 100  # per cent of a whole


@dataclass(frozen=True)
class Condition:
    """An open fact, which never makes a doubt: the values hold if it is as assumed."""

    fact: str  # one of the facts of docs/verdict.md, such as "thickness"
    text: str  # what is assumed
    remedy: str  # the words that state the fact
    alternative: str = ""  # with which the shifts are, as in "22 mm"; empty: none, and no value needs the fact
    shifts: Mapping[str, float] = field(default_factory=dict)  # [SI] of each value by the alternative, with signs
    code: str = ""  # of the flag by which older versions said it

    @classmethod
    def of_table(cls, table: Mapping[str, Any]) -> Condition:
        """Return the condition of a result that was read; a shift without a bound is null there."""
        alternative = table.get("alternative", "")
        text = str(table["message"])
        if alternative:  # what follows it is worked out from the values
            text = text.partition(f": {alternative} makes ")[0]
        shifts = dict[str, float]()
        for name, shift in table.get("shifts", {}).items():
            shifts[name] = math.inf if shift is None else shift
        return cls(
            fact=table["fact"],
            text=text,
            remedy=table.get("remedy", ""),
            alternative=alternative,
            shifts=shifts,
            code=table.get("code", ""),
        )

    def matters(self, values: Mapping[str, UncertainValue]) -> bool:
        """Return True if the alternative moves any value by its uncertainty; a condition without one always does."""
        if not self.alternative:
            return True
        for name, shift in self.shifts.items():
            # Not "at least": an uncertainty that is not known (NaN) is not below any shift.
            if name in values and abs(shift) > 0 and not abs(shift) < values[name].combined:
                return True
        return False

    def needed_by(self, name: str, value: UncertainValue) -> bool:
        """Return True if the alternative moves a value by more than half of it, or of two standard uncertainties."""
        size, u = abs(self.shifts.get(name, 0.0)), value.combined
        return bool(self.alternative) and size > _MAX_SHIFT * max(abs(value.value), 0.0 if math.isnan(u) else 2 * u)

    def sentence(self, values: Mapping[str, UncertainValue]) -> str:
        """Return the assumption, and the relative change of each value if the alternative were true.

        Values that change by less than their combined uncertainty are left out.

        >>> thick = Condition("thickness", "specimen thicker than 49 mm", "--thickness", "22 mm", {"elasticity": -6.5})
        >>> thick.sentence({"elasticity": UncertainValue(50.0, 1.0, "Pa")})
        'specimen thicker than 49 mm: 22 mm makes elasticity 13 % lower'
        """
        shares = dict[str, float]()
        for name, shift in self.shifts.items():
            value = values.get(name)
            if value is not None and value.value and value.combined <= abs(shift) < math.inf:
                shares[name] = shift / value.value
        if not shares or not self.alternative:
            return self.text
        return f"{self.text}: {self.alternative} makes {_changes(shares)}"

    def table(self, values: Mapping[str, UncertainValue]) -> dict[str, Any]:
        """Return the condition as in ``result.json``."""
        table = {
            "fact": self.fact,
            "message": self.sentence(values),
            "remedy": self.remedy,
            "alternative": self.alternative,
            "shifts": finite_tree(dict(self.shifts)),
            "needed_by": [name for name, value in values.items() if self.needed_by(name, value)],
        }
        return table | ({"code": self.code} if self.code else {})


def _changes(shares: Mapping[str, float]) -> str:
    """Return relative changes in words, the direction behind the last of those that share it.

    >>> _changes({"elasticity": 0.06, "viscosity": 0.091}), _changes({"elasticity": -0.06, "viscosity": 0.091})
    ('elasticity 6 %, viscosity 9.1 % higher', 'elasticity 6 % lower, viscosity 9.1 % higher')
    """
    phrases, names = [], list(shares)
    for name, following in zip(names, [*names[1:], None], strict=True):
        is_last = following is None or (shares[following] > 0) != (shares[name] > 0)
        direction = f" {'higher' if shares[name] > 0 else 'lower'}" if is_last else ""
        phrases.append(f"{name} {_percent(shares[name])}{direction}")
    return ", ".join(phrases)


def _percent(share: float) -> str:
    """Return a share in per cent, to two digits."""
    return f"{float(f'{_PERCENT * abs(share):.2g}'):g} %" if abs(share) < _MAX_SHARE else "more than tenfold"


def needs(conditions: Iterable[Condition], name: str, value: UncertainValue) -> str:
    """Return the fact that a value needs most; empty where it needs none."""
    needed = [condition for condition in conditions if condition.needed_by(name, value)]
    return max(needed, key=lambda condition: abs(condition.shifts[name])).fact if needed else ""


def joined(conditions: Sequence[Condition]) -> tuple[Condition, ...]:
    """Return one condition for each fact, the first that names it."""
    return tuple({condition.fact: condition for condition in reversed(conditions)}.values())[::-1]
