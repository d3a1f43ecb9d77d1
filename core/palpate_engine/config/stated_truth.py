"""True values of a specimen, as a pipeline or the facts of a rig state them; results are compared with them alone."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

from palpate.contact import ContactModel
from palpate.errors import suggest
from palpate.unit_symbols import UnknownUnitError, read_unit
from palpate.units import to_si

_COMMON = {"elasticity": "Pa", "viscosity": "Pa*s", "surface": "m"}  # units of values that any model may lead to
_ENTRY = re.compile(r"(?P<name>[a-z_][a-z0-9_]*)\s+(?P<number>[-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*(?P<unit>.*)")


def truth_in_words(text: object) -> dict[str, str]:
    """Return the quantities of a sentence by name; raises ValueError for another form.

    >>> truth_in_words("elasticity 112.5 kPa, viscosity 362 Pa*s")
    {'elasticity': '112.5 kPa', 'viscosity': '362 Pa*s'}
    """
    truth: dict[str, str] = {}
    for entry in re.split(r"[,;]", str(text)):
        match = _ENTRY.fullmatch(entry.strip())
        if match is None:
            raise ValueError(f'{entry.strip()!r} is not a name with its value, as in "elasticity 112.5 kPa"')
        try:
            read_unit(match["unit"] or "1")
        except UnknownUnitError as error:
            raise ValueError(f"{entry.strip()!r}: {error}") from error
        truth[match["name"]] = f"{match['number']} {match['unit']}".strip()
    return truth


def stated_truth(models: Mapping[str, ContactModel], stated: Mapping[str, float | str]) -> dict[str, float]:
    """Return true values [SI] by name; those with mistakes, see `wrong_truth`, are left out."""
    units, wrong = _units(models), dict(wrong_truth(models, stated))
    return {name: to_si(value, units[name]) for name, value in stated.items() if name not in wrong}


def wrong_truth(models: Mapping[str, ContactModel], stated: Mapping[str, float | str]) -> Iterator[tuple[str, str]]:
    """Return the names of true values with what is wrong with them: no model has them, or another dimension."""
    units = _units(models)
    for name, value in stated.items():
        if name not in units:
            yield name, f"is not a value of a model{suggest(name, units)} (there are: {', '.join(sorted(units))})"
            continue
        try:
            to_si(value, units[name])
        except ValueError as error:
            yield name, str(error)


def _units(models: Mapping[str, ContactModel]) -> dict[str, str]:
    return _COMMON | {parameter.name: parameter.unit for model in models.values() for parameter in model.parameters}
