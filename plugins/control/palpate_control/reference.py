"""The reference that a check is compared with: on the command line, or in a TOML table."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from palpate import ConfigurationError, suggest, to_si
from palpate_engine import Source, build_parts, dimension, plain_settings, registry
from palpate_kit.runs.toml_file import read_tables

QUANTITIES = {"Pa": "elasticity", "N/m": "stiffness", "Pa*s": "viscosity", "N*s/m": "damping"}
_KEYS = ("name", "value", "uncertainty", "tip")
_UNCERTAINTY = 'its standard uncertainty (k = 1; half of what a certificate states for k = 2), such as "1.5 kPa"'


@dataclass(frozen=True)
class Reference:
    """A reference specimen or spring [SI]."""

    name: str
    value: float
    unit: str
    std: float
    tip: dict[str, Any] | None = None  # with which its value was determined, where that is stated

    @property
    def quantity(self) -> str:
        """Name of the value of a run that is compared with it."""
        return QUANTITIES[self.unit]


def read_reference(text: str, uncertainty: str | None) -> Reference:
    """Return the reference of a command line: a value with a unit, or a TOML file; raises ConfigurationError."""
    if not text.endswith(".toml"):
        if uncertainty is None:
            raise ConfigurationError(f"--uncertainty is missing: the reference needs {_UNCERTAINTY}")
        return _reference("reference", text, uncertainty, "--reference", "--uncertainty")
    if uncertainty is not None:
        raise ConfigurationError(f"--uncertainty: {text} states that of its reference; leave one of them out")
    table = _table(Path(text))
    for key in table:
        if key not in _KEYS:
            raise ConfigurationError(f"{text}: [reference] {key}: no such key{suggest(key, _KEYS)}")
    missing = [key for key in ("name", "value", "uncertainty") if key not in table]
    if missing:
        meanings = {
            "name": "what the reference is",
            "value": 'its value, such as "112.5 kPa"',
            "uncertainty": _UNCERTAINTY,
        }
        raise ConfigurationError(f"{text}: [reference] {missing[0]} is missing: {meanings[missing[0]]}")
    keys = (f"{text}: [reference] value", f"{text}: [reference] uncertainty")
    tip = _tip(Path(text), table["tip"]) if "tip" in table else None
    return _reference(str(table["name"]), table["value"], table["uncertainty"], *keys, tip)


def _reference(
    name: str, value: Any, uncertainty: Any, value_key: str, std_key: str, tip: dict[str, Any] | None = None
) -> Reference:
    """Return a reference, each of its two numbers checked under its key."""
    unit = _unit(value, value_key)
    number, std = (_number(text, unit, key) for text, key in ((value, value_key), (uncertainty, std_key)))
    return Reference(name, number, unit, std, tip)


def _unit(value: Any, key: str) -> str:
    """Return the SI unit of a value with a unit."""
    if not isinstance(value, str) or re.fullmatch(r"\s*[-+.\deE]+\s*", value):
        raise ConfigurationError(
            f'{key}: {value!r} has no unit; write for example "112.5 kPa", or "3.2 N/mm" of a spring'
        )
    for unit in QUANTITIES:
        try:
            to_si(value, unit)
        except ValueError:
            continue
        return unit
    allowed = ", ".join(dimension(unit) for unit in QUANTITIES)
    raise ConfigurationError(f"{key}: {value!r} is not one of {allowed}")


def _number(value: Any, unit: str, key: str) -> float:
    if not isinstance(value, str):
        raise ConfigurationError(f"{key}: {value!r} has no unit")
    try:
        number = to_si(value, unit)
    except ValueError as error:
        raise ConfigurationError(f"{key}: {error}") from error
    if number <= 0:
        raise ConfigurationError(f"{key}: {value!r} must be larger than 0")
    return number


def _table(path: Path) -> dict[str, Any]:
    table = read_tables(path, "reference").get("reference")
    if not isinstance(table, dict):
        raise ConfigurationError(f"{path}: the table [reference] is missing: name, value, uncertainty")
    return table


def _tip(path: Path, table: Any) -> dict[str, Any]:
    """Return the tip of a reference as runs state theirs."""
    source = Source("", path)
    source.tables = {"indenter": {"tip": table}}
    parts = registry.load()
    settings: dict[str, Any] = plain_settings(build_parts(source, "indenter", parts)["tip"], parts)
    return settings
