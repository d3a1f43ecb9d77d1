"""A pipeline file as text: its tables, and the line on which each key stands."""

from __future__ import annotations

import re
import tomllib
from copy import deepcopy
from pathlib import Path
from typing import Any

from palpate.errors import ConfigurationError, suggest
from palpate.input_file import Enclosure, check_input
from palpate.key_mistakes import Location
from palpate.offers import Template
from palpate.registry import offers
from palpate.trust import is_argument, is_named

_BARE_QUANTITY = re.compile(r"=\s*[-+.\d]+\s*[A-Za-z]+\s*(#.*)?$")
_TABLE = re.compile(r"\s*\[\[?([^\[\]]+)\]\]?\s*(?:#.*)?$")
_KEY = re.compile(r"""\s*((?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*')(?:\s*\.\s*(?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*'))*)\s*=""")

_PLUGINS = ("run", "plugins")
_MAX_NESTING = 32  # tables and lists in each other, far from the interpreter's limit of recursion: a choice


class Source:
    """The text of a pipeline file, parsed, with the overrides of the command line on top.

    That a person has `named` the file is their consent to the plugin files that it names. Where a log carries it, an
    `enclosure` holds the files that it may name.
    """

    def __init__(self, text: str, path: Path, named: bool = False, enclosure: Enclosure | None = None) -> None:
        """Parse the text of a file; raises ConfigurationError where it is not TOML, or nested too deeply.

        `named`: a person has named the file; `enclosure`: the files that it may name, where a log carries it.
        """
        self.enclosure = enclosure
        self.text = text
        self.path = path
        self.named = named
        try:
            self.tables: dict[str, Any] = tomllib.loads(text)
        except (ValueError, RecursionError) as error:  # of a number of 5000 digits, of 5000 brackets, too
            raise ConfigurationError(_message_with_caret(text, path, str(error))) from error
        if _is_nested_deeper(self.tables, _MAX_NESTING):
            raise ConfigurationError(f"{path}: tables and lists are nested more than {_MAX_NESTING} deep")
        self._lines = _key_lines(text)
        self._stated: dict[Location, str] = {}  # keys that are set, and by which facts; "": by the command line
        self._plugins_named = False  # by the person at work
        self.inherited: dict[Location, str] = {}  # ``file:line`` of the keys that its bases state
        self.base_safety: dict[str, Any] = {}  # limits of its bases

    @classmethod
    def read(cls, path: Path, named: bool = True) -> Source:
        """Return the pipeline file at a path, which a person has `named`, unless it was found in a run folder.

        At the command line it counts as named only if it is among the arguments. Raises ConfigurationError where it
        cannot be read.
        """
        try:
            check_input(path)
            return cls(path.read_text(encoding="utf-8"), path, named and is_named(path))
        except (OSError, UnicodeDecodeError) as error:
            reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
            if isinstance(error, FileNotFoundError):
                reason = f"{reason}{_hint_of_missing(path)}"
            raise ConfigurationError(f"{path}: cannot read the pipeline file: {reason}") from error
        except ValueError as error:
            raise ConfigurationError(str(error)) from error

    def override(self, assignment: str) -> None:
        """Apply one ``table.key=value`` of the command line; the value is TOML, or a text where it is not."""
        keys, value = parsed_assignment(assignment)
        self.state(keys, value)
        if keys == _PLUGINS:
            self._plugins_named = is_argument(assignment)

    def state(self, keys: Location, value: Any, by: str = "") -> None:
        """Set a key, stated `by` the command line or what messages are to name; raises ConfigurationError."""
        table: Any = self.tables
        for i, key in enumerate(keys[:-1]):
            if keys[0] == "alignment" and isinstance(table.get(key), str):  # a signal in its short form
                table[key] = {"channel": table[key]}
            # Tables around the key are made where they are missing.
            table = table.setdefault(key, {})
            if not isinstance(table, dict):
                statement = by or f"--set {'.'.join(keys)}"
                raise ConfigurationError(f"{statement}: {'.'.join(keys[: i + 1])} is not a table")
        table[keys[-1]] = value
        self._stated[keys] = by

    def drop(self, keys: Location) -> None:
        """Take a key out of the tables, if it is there."""
        table = _value_at(self.tables, keys[:-1])
        if isinstance(table, dict):
            table.pop(keys[-1], None)

    def exchange(self, tables: dict[str, Any]) -> None:
        """Put other tables in place, with what the command line has set."""
        statements = [(keys, _value_at(self.tables, keys), origin) for keys, origin in self._stated.items()]
        self.tables.clear()
        self.tables.update(deepcopy(tables))
        for keys, value, origin in statements:
            if value is not None:
                self.state(keys, value, origin)

    def is_stated(self, location: Location) -> bool:
        """Return True if the command line has set a key, or a table around it."""
        return any(location[:length] in self._stated for length in range(1, len(location) + 1))

    @property
    def has_chosen_plugins(self) -> bool:
        """True if a person has chosen its plugin files: by naming the file, or by setting them on the command line."""
        return self._plugins_named if _PLUGINS in self._stated else self.named

    @property
    def overridden(self) -> list[str]:
        """Keys that the command line, or the facts of a rig, have set."""
        return sorted(".".join(keys) for keys in self._stated)

    def table(self, location: Location) -> dict[str, Any]:
        """Return the table at a location."""
        table: dict[str, Any] = self.tables
        for key in location:
            table = table[key]
        return table

    def where(self, location: Location) -> str:
        """Return ``file:line`` of a location, of the nearest table around it, or the command line that set it."""
        # From the key itself outwards: the command line, a base, then the file.
        for length in range(len(location), 0, -1):
            head = location[:length]
            if head in self._stated:
                return self._stated[head] or f"--set {'.'.join(head)}"
            if head in self.inherited:
                return self.inherited[head]
            if head in self._lines:
                return f"{self.path}:{self._lines[head]}"
        return str(self.path)

    def line(self, location: Location) -> int:
        """Return the line of a location, for sorting; 0 where it has none."""
        return next((self._lines[location[:n]] for n in range(len(location), 0, -1) if location[:n] in self._lines), 0)


def _value_at(tables: Any, keys: Location) -> Any:
    """Return the value at a place in nested tables; None where a table or the key is missing."""
    for key in keys:
        tables = tables.get(key) if isinstance(tables, dict) else None
    return tables


def parsed_assignment(text: str) -> tuple[Location, Any]:
    """Return keys and value of ``table.key=value``, which is TOML, or else a text; raises ConfigurationError."""
    name, equals, written = text.partition("=")
    keys = _keys_of(name)
    if not equals or len(keys) < 2 or not all(keys):
        raise ConfigurationError(f"--set {text}: write table.key=value, such as estimator.ekf.force_std=0.1")
    return keys, _toml_value(written.strip())


def _message_with_caret(text: str, path: Path, problem: str) -> str:
    """Return a message about text that is not TOML, with the line and a caret below the place."""
    place = re.search(r"\s*\(at line (\d+), column (\d+)\)$", problem)
    if place is None:
        return f"{path}: not TOML: {problem}"
    line, column = int(place[1]), int(place[2])
    line_text = text.splitlines()[line - 1].replace("\t", " ")
    hint = "; a quantity with a unit is a text" if _BARE_QUANTITY.search(line_text) else ""
    head = f"{path}:{line}: not TOML: {problem[: place.start()]} at line {line}, column {column}{hint}"
    return f"{head}\n  {line_text}\n  {' ' * (column - 1)}^"


def _toml_value(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):
        return text


def _is_nested_deeper(value: Any, depth: int) -> bool:
    """Return True if tables and lists are nested more than `depth` deep."""
    if not isinstance(value, dict | list):
        return False
    inner = value.values() if isinstance(value, dict) else value
    return depth == 0 or any(_is_nested_deeper(item, depth - 1) for item in inner)


def _key_lines(text: str) -> dict[Location, int]:
    """Return the line of every table header and of every key that begins a line; keys of inline tables share a line."""
    lines: dict[Location, int] = {}
    table: Location = ()
    for number, line in enumerate(text.splitlines(), start=1):
        if header := _TABLE.match(line):
            table = _keys_of(header[1])
            lines.setdefault(table, number)
        elif key := _KEY.match(line):
            lines.setdefault(table + _keys_of(key[1]), number)
    return lines


def _keys_of(dotted: str) -> Location:
    return tuple(part.strip().strip("\"'") for part in dotted.split("."))


def _hint_of_missing(path: Path) -> str:
    """Return a hint where a pipeline file is missing: the command that writes it, or a name in the same folder."""
    if path.name.removesuffix(".toml") in offers("palpate_templates", Template):
        name = path.name.removesuffix(".toml")
        return f"; type palpate init {name}, which writes {name}.toml, and name that file"
    neighbours = [file.name for file in path.parent.glob("*.toml")]
    return suggest(path.name, neighbours) if neighbours else ""
