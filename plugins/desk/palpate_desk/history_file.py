"""``history.csv``: the actions on the page, as the commands that do the same; they are never executed from there."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from palpate import ConfigurationError, LogError, printable
from palpate_engine import file_in_place

from palpate_desk.action import Action
from palpate_desk.command_gate import demand_allowed, is_change

HISTORY = "history.csv"
_COLUMNS = ("number", "time", "command")


@dataclass(frozen=True)
class ActionHistory:
    """History of a folder: a text that anybody may have written."""

    folder: Path

    @property
    def path(self) -> Path:
        """The path of the file."""
        return self.folder / HISTORY

    @property
    def commands(self) -> list[str]:
        """The command of every row, empty for a row without one; raises LogError."""
        return [row.get("command") or "" for row in csv.DictReader(io.StringIO(self._whole_lines()))]

    def demand_readable(self) -> None:
        """Raise LogError where no action can be added, so that none is done that the history lacks."""
        self._whole_lines()

    def append(self, action: Action) -> None:
        """Add an action as a row: number, time, command; raises LogError, OutputError."""
        text = self._whole_lines()
        time = datetime.now(UTC).isoformat(timespec="milliseconds")
        addition = io.StringIO()
        columns = next(csv.reader(io.StringIO(text)), _COLUMNS)  # an older file has more
        table = csv.DictWriter(addition, columns, lineterminator="\n")
        if not text:
            table.writeheader()
        table.writerow({"number": len(self.commands) + 1, "time": time, "command": action.text})
        # In place of a last line that is torn.
        with file_in_place(self.path) as file:
            file.seek(len(text.encode()))
            file.truncate()
            file.write(addition.getvalue().encode())

    def _whole_lines(self) -> str:
        """Return the text without a last line that was torn in writing; raises LogError for a file of another kind."""
        if not self.path.is_file():
            return ""
        try:
            content = self.path.read_bytes()
            text = content[: content.rfind(b"\n") + 1].decode("utf-8")
            rows = list(csv.reader(io.StringIO(text)))
        except (OSError, UnicodeDecodeError, csv.Error) as error:
            raise LogError(f"{self.path}: cannot be read: {error}") from error
        if rows and not set(_COLUMNS) <= set(rows[0]):
            raise LogError(f"{self.path}: is not a history of palpate desk: it has no columns {', '.join(_COLUMNS)}")
        return text

    @property
    def script(self) -> str:
        """The history as a shell script for another folder; commands that the page cannot make are comments.

        Raises LogError, and ConfigurationError for an empty history.
        """
        commands = self.commands
        if not commands:
            raise ConfigurationError(f"{self.folder}: has no history: nothing was done there with palpate desk")
        head = [
            "#!/bin/sh",
            f"# What palpate desk did in {printable(str(self.folder))}, for another folder: sh SCRIPT FOLDER",
            "set -e",
        ]
        return "\n".join([*head, "out=${1:?which folder}", *map(_script_line, commands)]) + "\n"


def _script_line(command: str) -> str:
    """Return the line of a script for a command, written again as the page writes it, or as a comment."""
    try:
        action = Action.of(command)
        demand_allowed(action)
        if is_change(action):
            return action.text
    except ConfigurationError:
        pass
    return f"# left out, since the page cannot do it: {printable(command)}"
