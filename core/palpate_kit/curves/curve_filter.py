"""Filter words: which rows of a table of curves are meant."""

from __future__ import annotations

import operator
import re
import shlex
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from palpate import ConfigurationError, suggest, to_si
from palpate_engine import SEVERITIES, display_unit

from palpate_kit.curves.curve_row import CurveRow
from palpate_kit.curves.fit_folder import FitFolder

Test = Callable[[CurveRow], bool]
_WORD = re.compile(r"(?P<name>[^<>=:]+)(?P<sign><=|>=|<|>|=|:)(?P<value>.*)")
_SIGNS: Mapping[str, Callable[[float, float], bool]] = {
    "<": operator.lt, ">": operator.gt, "<=": operator.le, ">=": operator.ge,
}  # fmt: skip
_CHOICES = {
    "verdict": ("good", *(word for word in SEVERITIES)),
    "mark": ("good", "bad", "none"),
    "state": ("current", "stale", "missing"),
}
_OF_VALUES = ("good", "doubtful", "invalid", "needs", "not-determined")  # the verdict of a value
_PLACE = ("x", "y")
_NUMBERS = {"rms": "N", "samples": "1", **dict.fromkeys(_PLACE, "m")}


@dataclass(frozen=True)
class CurveFilter:
    """What words a row must fulfil, all of them."""

    words: str
    tests: tuple[Test, ...] = ()

    def __call__(self, row: CurveRow) -> bool:
        """Return True if a row is meant."""
        return all(test(row) for test in self.tests)

    def choose(self, rows: Iterable[CurveRow]) -> list[CurveRow]:
        """Return the rows that are meant."""
        return [row for row in rows if self(row)]


def curve_filter(words: str | None, folder: FitFolder, codes: Iterable[str] = ()) -> CurveFilter:
    """Return the filter of words such as ``flag:saturated verdict:doubtful sample=S1 E>100 rms<0.05 S1_07``.

    `codes` are flags that may be named besides those of the rows. A number without a unit is in the unit in which it is
    shown. Raises ConfigurationError for the first unknown word.
    """
    try:
        split = shlex.split(words or "")
    except ValueError as error:
        raise ConfigurationError(f"--where {words!r}: {error}") from error
    known = {*codes, *(code for row in folder.rows for code in row.flags)}
    return CurveFilter(words or "", tuple(_test(word, folder, known) for word in split))


def _test(word: str, folder: FitFolder, codes: set[str]) -> Test:
    found = _WORD.fullmatch(word)
    if found is None:
        return lambda row: word.casefold() in row.curve.casefold()
    name, sign, value = found["name"], found["sign"], found["value"]
    if sign == ":":
        return _choice(word, name, value, codes, folder)
    if sign == "=":
        return _equal(word, name, value, folder)
    return _comparison(word, name, sign, value, folder)


def _choice(word: str, name: str, value: str, codes: set[str], folder: FitFolder) -> Test:
    key = folder.symbols.get(name, name)
    if key in folder.values:
        if value not in _OF_VALUES:
            raise ConfigurationError(f"--where {word!r}: {value!r} is not a verdict{suggest(value, _OF_VALUES)}")
        return lambda row: row.verdict_of(key).replace(" ", "-").startswith(value)
    if name == "condition":
        facts = {fact for row in folder.rows for fact in row.conditions}
        if value not in facts:
            raise ConfigurationError(f"--where {word!r}: no curve has the condition {value!r}{suggest(value, facts)}")
        return lambda row: value in row.conditions
    if name == "flag":
        if value not in codes:
            raise ConfigurationError(f"--where {word!r}: no curve has the flag {value!r}{suggest(value, codes)}")
        return lambda row: value in row.flags
    if name not in _CHOICES:
        raise ConfigurationError(f"--where {word!r}: no {name!r}{suggest(name, ['flag', 'condition', *_CHOICES])}")
    if value not in _CHOICES[name]:
        raise ConfigurationError(f"--where {word!r}: {value!r} is not a {name}{suggest(value, _CHOICES[name])}")
    return lambda row: getattr(row, name) == value


def _equal(word: str, name: str, value: str, folder: FitFolder) -> Test:
    if name == "curve":
        if value not in folder.names:
            raise ConfigurationError(f"--where {word!r}: no curve {value!r}{suggest(value, folder.names)}")
        return lambda row: row.curve == value
    if name == "track":
        return lambda row: row.track == value
    if name not in folder.columns:
        known = ["curve", "track", *folder.columns]
        raise ConfigurationError(f"--where {word!r}: curves.csv has no column {name!r}{suggest(name, known)}")
    return lambda row: row.groups.get(name, "") == value


def _comparison(word: str, name: str, sign: str, value: str, folder: FitFolder) -> Test:
    key = folder.symbols.get(name, name)
    if key not in (*folder.values, *_NUMBERS):
        known = [*folder.symbols, *folder.values, *_NUMBERS]
        raise ConfigurationError(f"--where {word!r}: no number {name!r}{suggest(name, known)}")
    unit = _NUMBERS.get(key, folder.units.get(key, ""))
    try:
        limit = float(value) / display_unit(unit)[1]
    except ValueError:
        try:
            limit = to_si(value, unit)
        except ValueError as error:
            raise ConfigurationError(f"--where {word!r}: {error}") from error
    compare = _SIGNS[sign]

    def holds(row: CurveRow) -> bool:
        number = _number(row, key)
        return number is not None and compare(number, limit)

    return holds


def _number(row: CurveRow, key: str) -> float | None:
    """Return a number of a row [SI]; its place is that of the map: as it is stated, else as it was measured."""
    if key not in _PLACE:
        return row.number(key)
    return None if row.place is None else row.place[_PLACE.index(key)]
