"""A pipeline file as text: its tables, and the line on which each key stands."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from palpate.errors import ConfigurationError

_TABLE = re.compile(r"\s*\[\[?([^\[\]]+)\]\]?\s*(?:#.*)?$")
_KEY = re.compile(r"""\s*((?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*')(?:\s*\.\s*(?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*'))*)\s*=""")

Location = tuple[str, ...]  # ("device", "log", "columns", "z")


class Source:
    """The text of a pipeline file, parsed, with the overrides of the command line on top."""

    def __init__(self, text: str, path: Path) -> None:
        self.text = text
        self.path = path
        try:
            self.tables: dict[str, Any] = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise ConfigurationError(f"{path}: not TOML: {error}") from error
        self._lines = _lines(text)
        self._overridden: set[Location] = set()

    @classmethod
    def read(cls, path: Path) -> Source:
        """The pipeline file at a path; raises ConfigurationError where it cannot be read."""
        try:
            return cls(path.read_text(encoding="utf-8"), path)
        except (OSError, UnicodeDecodeError) as error:
            reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
            raise ConfigurationError(f"{path}: cannot read the pipeline file: {reason}") from error

    def override(self, assignment: str) -> None:
        """Apply one ``table.key=value`` of the command line; the value is TOML, or a text where it is not."""
        name, equals, written = assignment.partition("=")
        keys = tuple(key.strip().strip("\"'") for key in name.split("."))
        if not equals or len(keys) < 2 or not all(keys):
            raise ConfigurationError(f"--set {assignment}: write table.key=value, such as estimator.ekf.force_std=0.1")
        table: Any = self.tables
        for i, key in enumerate(keys[:-1]):
            if keys[0] == "alignment" and isinstance(table.get(key), str):  # a signal in its short form
                table[key] = {"channel": table[key]}
            table = table.setdefault(key, {})
            if not isinstance(table, dict):
                raise ConfigurationError(f"--set {assignment}: {'.'.join(keys[: i + 1])} is no table")
        table[keys[-1]] = _toml_value(written.strip())
        self._overridden.add(keys)

    def where(self, location: Location) -> str:
        """``file:line`` of a location, of the nearest table around it, or the command line that set it."""
        for length in range(len(location), 0, -1):
            head = location[:length]
            if head in self._overridden:
                return f"--set {'.'.join(head)}"
            if head in self._lines:
                return f"{self.path}:{self._lines[head]}"
        return str(self.path)

    def line(self, location: Location) -> int:
        """The line of a location, for sorting; 0 where it has none."""
        return next((self._lines[location[:n]] for n in range(len(location), 0, -1) if location[:n] in self._lines), 0)


def _toml_value(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def _lines(text: str) -> dict[Location, int]:
    """Line of every table header and every key that begins a line; keys of inline tables share their line."""
    lines: dict[Location, int] = {}
    table: Location = ()
    for number, line in enumerate(text.splitlines(), start=1):
        if header := _TABLE.match(line):
            table = _split(header[1])
            lines.setdefault(table, number)
        elif key := _KEY.match(line):
            lines.setdefault(table + _split(key[1]), number)
    return lines


def _split(dotted: str) -> Location:
    return tuple(part.strip().strip("\"'") for part in dotted.split("."))
