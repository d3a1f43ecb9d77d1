"""``history.csv``: what was done on the page, as the commands that do the same; never done again from there."""

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
    """The history of a folder: text that anybody may have written."""

    folder: Path

    @property
    def path(self) -> Path:
        """The file."""
        return self.folder / HISTORY

    @property
    def commands(self) -> list[str]:
        """The command of every row, empty where it has none; raises LogError."""
        return [row.get("command") or "" for row in csv.DictReader(io.StringIO(self._whole_lines()))]

    def demand_readable(self) -> None:
        """Raise LogError where nothing can be added, so that nothing is done that the history does not have."""
        self._whole_lines()

    def append(self, action: Action) -> None:
        """Add what was done; raises LogError, OutputError."""
        text = self._whole_lines()
        stamp = datetime.now(UTC).isoformat(timespec="milliseconds")
        line = io.StringIO()
        columns = next(csv.reader(io.StringIO(text)), _COLUMNS)  # an older file has more
        table = csv.DictWriter(line, columns, lineterminator="\n")
        if not text:
            table.writeheader()
        table.writerow({"number": len(self.commands) + 1, "time": stamp, "command": action.text})
        with file_in_place(self.path) as file:
            file.seek(len(text.encode()))
            file.truncate()
            file.write(line.getvalue().encode())

    def _whole_lines(self) -> str:
        """Return the text without a last line that was torn in writing; raises LogError for what is not a history."""
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
        """All of it as a shell script for another folder; what the page does not do is a comment.

        Raises LogError, and ConfigurationError where nothing was done.
        """
        commands = self.commands
        if not commands:
            raise ConfigurationError(f"{self.folder}: has no history: nothing was done there with palpate desk")
        head = [
            "#!/bin/sh",
            f"# What palpate desk did in {printable(str(self.folder))}, for another folder: sh SCRIPT FOLDER",
            "set -e",
        ]
        return "\n".join([*head, "out=${1:?which folder}", *map(_line, commands)]) + "\n"


def _line(command: str) -> str:
    """Return the line of a script: a command that the page can make, as it writes it; anything else as a comment."""
    try:
        action = Action.of(command)
        demand_allowed(action)
        if is_change(action):
            return action.text
    except ConfigurationError:
        pass
    return f"# left out, since the page cannot do it: {printable(command)}"
