"""Terms such as ``flag:saturated`` or ``E>100`` by which rows of a table of curves are chosen."""

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

Test = Callable[[CurveRow], bool]  # of a row: True if it fulfils a term
_TERM = re.compile(r"(?P<name>[^<>=:]+)(?P<sign><=|>=|<|>|=|:)(?P<value>.*)")
_COMPARISONS: Mapping[str, Callable[[float, float], bool]] = {
    "<": operator.lt, ">": operator.gt, "<=": operator.le, ">=": operator.ge,
}  # fmt: skip
_CHOICES = {
    "verdict": ("good", *SEVERITIES),
    "mark": ("good", "bad", "none"),
    "state": ("current", "stale", "missing"),
}
_VALUE_VERDICTS = ("good", "doubtful", "invalid", "needs", "not-determined")
_PLACE = ("x", "y")
# Numbers of a row other than the values of its parameters, with their units in SI.
_UNITS_OF_NUMBERS = {"rms": "N", "samples": "1", **dict.fromkeys(_PLACE, "m")}


@dataclass(frozen=True)
class CurveFilter:
    """Terms that a chosen row fulfils, all of them."""

    words: str
    tests: tuple[Test, ...] = ()

    def __call__(self, row: CurveRow) -> bool:
        """Return True if a row fulfils every term."""
        return all(test(row) for test in self.tests)

    def choose(self, rows: Iterable[CurveRow]) -> list[CurveRow]:
        """Return the rows that fulfil every term."""
        return [row for row in rows if self(row)]


def curve_filter(words: str | None, folder: FitFolder, codes: Iterable[str] = ()) -> CurveFilter:
    """Return the filter of terms such as ``flag:saturated verdict:doubtful sample=S1 E>100 rms<0.05 S1_07``.

    `codes` are flags that may be named in addition to those of the rows. A number without a unit is in the unit in
    which it is shown. Raises ConfigurationError for the first unknown term.
    """
    try:
        terms = shlex.split(words or "")
    except ValueError as error:
        raise ConfigurationError(f"--where {words!r}: {error}") from error
    permitted_codes = {*codes, *(code for row in folder.rows for code in row.flags)}
    return CurveFilter(words or "", tuple(_test_of_term(term, folder, permitted_codes) for term in terms))


def _test_of_term(term: str, folder: FitFolder, codes: set[str]) -> Test:
    """Return the test of NAME:WORD, NAME=TEXT or NAME<NUMBER; a term without a sign is a part of a curve's name."""
    match = _TERM.fullmatch(term)
    if match is None:
        return lambda row: term.casefold() in row.curve.casefold()
    name, sign, value = match["name"], match["sign"], match["value"]
    if sign == ":":
        return _word_test(term, name, value, codes, folder)
    if sign == "=":
        return _equality_test(term, name, value, folder)
    return _number_test(term, name, sign, value, folder)


def _word_test(term: str, name: str, value: str, codes: set[str], folder: FitFolder) -> Test:
    """Return the test of rows for a verdict, condition, flag, mark or state: `name` = `value`, from the word `term`.

    `codes` are those of all flags. Raises ConfigurationError for an unknown name or value.
    """
    key = folder.symbols.get(name, name)
    if key in folder.values:
        if value not in _VALUE_VERDICTS:
            raise ConfigurationError(f"--where {term!r}: {value!r} is not a verdict{suggest(value, _VALUE_VERDICTS)}")
        return lambda row: row.verdict_of(key).replace(" ", "-").startswith(value)
    if name == "condition":
        facts = {fact for row in folder.rows for fact in row.conditions}
        if value not in facts:
            raise ConfigurationError(f"--where {term!r}: no curve has the condition {value!r}{suggest(value, facts)}")
        return lambda row: value in row.conditions
    if name == "flag":
        if value not in codes:
            raise ConfigurationError(f"--where {term!r}: no curve has the flag {value!r}{suggest(value, codes)}")
        return lambda row: value in row.flags
    if name not in _CHOICES:
        raise ConfigurationError(f"--where {term!r}: no {name!r}{suggest(name, ['flag', 'condition', *_CHOICES])}")
    if value not in _CHOICES[name]:
        raise ConfigurationError(f"--where {term!r}: {value!r} is not a {name}{suggest(value, _CHOICES[name])}")
    return lambda row: getattr(row, name) == value


def _equality_test(term: str, name: str, value: str, folder: FitFolder) -> Test:
    """Return the test of a curve, a track or a column of ``curves.csv``; raises ConfigurationError for none of them."""
    if name == "curve":
        if value not in folder.names:
            raise ConfigurationError(f"--where {term!r}: no curve {value!r}{suggest(value, folder.names)}")
        return lambda row: row.curve == value
    if name == "track":
        return lambda row: row.track == value
    if name not in folder.columns:
        columns = ["curve", "track", *folder.columns]
        raise ConfigurationError(f"--where {term!r}: curves.csv has no column {name!r}{suggest(name, columns)}")
    return lambda row: row.groups.get(name, "") == value


def _number_test(term: str, name: str, comparison: str, limit_text: str, folder: FitFolder) -> Test:
    """Return the test of a number of a row against a limit by a `comparison` such as ``<``, for a term ``rms<0.05 N``.

    A limit without a unit is in the unit in which tables show the number: ``E>100`` is of 100 kPa where they have kPa.
    A row that lacks the number fails. Raises ConfigurationError for an unknown number or unit.
    """
    key = folder.symbols.get(name, name)
    if key not in (*folder.values, *_UNITS_OF_NUMBERS):
        numbers = [*folder.symbols, *folder.values, *_UNITS_OF_NUMBERS]
        raise ConfigurationError(f"--where {term!r}: no number {name!r}{suggest(name, numbers)}")
    # The limit in SI.
    unit = _UNITS_OF_NUMBERS.get(key, folder.units.get(key, ""))
    _, shown_per_si = display_unit(unit)
    try:
        limit = float(limit_text) / shown_per_si
    except ValueError:
        try:
            limit = to_si(limit_text, unit)
        except ValueError as error:
            raise ConfigurationError(f"--where {term!r}: {error}") from error
    compare = _COMPARISONS[comparison]

    def fulfils(row: CurveRow) -> bool:
        """Return True if a row has the number, and it compares so with the limit."""
        number = _number_of_row(row, key)
        return number is not None and compare(number, limit)

    return fulfils


def _number_of_row(row: CurveRow, key: str) -> float | None:
    """Return a number of a row [SI]; x and y as ``curves.csv`` states them, else as they were measured."""
    if key not in _PLACE:
        return row.number(key)
    return None if row.place is None else row.place[_PLACE.index(key)]
