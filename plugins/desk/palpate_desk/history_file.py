"""``history.csv``: what was done on the page, as the commands that do the same; only ever appended to."""

from __future__ import annotations

import csv
import io
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from palpate import ConfigurationError, LogError, OutputError

HISTORY = "history.csv"
OUT = "$out"  # stands for the folder
_COLUMNS = ("number", "time", "command", "inverse", "undoes")
_AND = "&&"


@dataclass(frozen=True)
class Action:
    """A command on the folder: its words, and its options with their values."""

    command: str
    options: tuple[tuple[str, str], ...] = ()  # a value that is empty is of a flag
    sources: tuple[str, ...] = (OUT,)

    @property
    def text(self) -> str:
        """The command line."""
        words = ["palpate", *self.command.split(), *self.sources]
        for option, value in self.options:
            words += [option, value] if value else [option]
        return " ".join(f'"{OUT}"' if word == OUT else shlex.quote(word) for word in words)


def where_curve(name: str) -> str:
    """The filter words of one curve."""
    return shlex.join([f"curve={name}"])


def actions_of(text: str) -> Iterator[Action]:
    """The actions of a line of commands that `Action.text` has written, joined by ``&&``."""
    words: list[str] = []
    for word in [*shlex.split(text), _AND]:
        if word != _AND:
            words.append(word)
            continue
        first = words.index(OUT)
        options: list[tuple[str, str]] = []
        for text_ in words[first + 1 :]:
            if text_.startswith("--") and (not options or options[-1][1] or options[-1][0] in ("--no-refit",)):
                options.append((text_, ""))
            else:
                options[-1] = (options[-1][0], text_)
        yield Action(" ".join(words[1:first]), tuple(options))
        words = []


@dataclass(frozen=True)
class HistoryEntry:
    """One line of the history."""

    number: int
    command: str
    inverse: str
    undoes: int | None


@dataclass(frozen=True)
class ActionHistory:
    """The history of a folder."""

    folder: Path

    @property
    def path(self) -> Path:
        """The file."""
        return self.folder / HISTORY

    @property
    def entries(self) -> list[HistoryEntry]:
        """All of it; a last line that was torn in writing is left out. Raises LogError."""
        if not self.path.is_file():
            return []
        try:
            text = self.path.read_text(encoding="utf-8")
            rows = list(csv.DictReader(io.StringIO(text[: text.rfind("\n") + 1])))
            return [
                HistoryEntry(
                    int(row["number"]), row["command"], row["inverse"], int(row["undoes"]) if row["undoes"] else None
                )
                for row in rows
            ]
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise LogError(f"{self.path}: is no history of palpate desk: {error}") from error

    def append(self, action: Action, inverse: Sequence[Action] = (), undoes: int | None = None) -> HistoryEntry:
        """Add what was done, with what undoes it; raises OutputError."""
        entries = self.entries
        entry = HistoryEntry(len(entries) + 1, action.text, f" {_AND} ".join(one.text for one in inverse), undoes)
        stamp = datetime.now(UTC).isoformat(timespec="milliseconds")
        line = io.StringIO()
        table = csv.writer(line, lineterminator="\n")
        if not entries:
            table.writerow(_COLUMNS)
        table.writerow((entry.number, stamp, entry.command, entry.inverse, "" if undoes is None else undoes))
        try:
            with self.path.open("r+b" if self.path.exists() else "w+b") as file:
                file.seek(0)
                whole = file.read().rfind(b"\n") + 1 if entries else 0
                file.truncate(whole)
                file.seek(whole)
                file.write(line.getvalue().encode())
        except OSError as error:
            raise OutputError(f"{self.path}: cannot write: {error.strerror}") from error
        return entry

    @property
    def latest(self) -> HistoryEntry | None:
        """The latest entry that can be undone and was not."""
        entries = self.entries
        gone = {entry.undoes for entry in entries}
        return next((e for e in reversed(entries) if e.inverse and e.undoes is None and e.number not in gone), None)

    @property
    def script(self) -> str:
        """All of it as a shell script for another folder; raises ConfigurationError where there is nothing."""
        entries = self.entries
        if not entries:
            raise ConfigurationError(f"{self.folder}: has no history: nothing was done there with palpate desk")
        head = [
            "#!/bin/sh",
            f"# What palpate desk did in {self.folder}, for another folder: sh SCRIPT FOLDER",
            "set -e",
        ]
        return "\n".join([*head, "out=${1:?which folder}", *(entry.command for entry in entries)]) + "\n"
