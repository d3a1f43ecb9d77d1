"""The desk: a folder of fits, and the actions on it, each by the command that does the same."""

from __future__ import annotations

import contextlib
import fcntl
import io
import json
import os
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, Any, Literal

import typer
from palpate import ConfigurationError, OutputError, printable, suggest
from palpate_engine import RIG, analysis, file_in_place, inherited_approval, option_of, registry
from palpate_kit.curves.curve import Curve
from palpate_kit.curves.curve_filter import curve_filter
from palpate_kit.curves.curve_fits import CurveReader, Row
from palpate_kit.curves.curve_pipelines import curve_reader
from palpate_kit.curves.curve_row import CurveRow
from palpate_kit.curves.curve_rows import table_of
from palpate_kit.curves.curve_table import FitTable
from palpate_kit.curves.fit_folder import FitFolder
from palpate_kit.runs.review_file import Mark, write_mark

from palpate_desk.action import Action, where_curve
from palpate_desk.command_gate import FACT_KEYS, demand_allowed
from palpate_desk.history_file import ActionHistory
from palpate_desk.settings_undo import fact_inverse, model_inverse, own_inverse, setting_inverse, tip_inverse

_LOCK = ".desk.lock"
_WATCHED_FILES = ("fits.csv", "curves.csv", "own.toml", "review.json", "pipeline*.toml", RIG)
_PID_LENGTH = 20  # characters of the lock file that hold a process's number
# Arguments of the functions of commands, by option.
_LIST_ARGUMENTS = {
    "--set": "overrides",
    "--unset": "unset",
    "--reject": "reject",
    "--accept": "accept",
    "--clear": "clear",
}
_FACT_OPTIONS = {option_of(key): key for key in FACT_KEYS}
_TEXT_ARGUMENTS = {"--where": "where", "--tip": "tip", "--model": "model", "--reason": "reason"}


@contextlib.contextmanager
def writing(path: Path) -> Iterator[IO[bytes]]:
    """Hold the lock of a folder, which one desk at a time may have; raises OutputError if another process has it.

    The lock file has the process's number. The system releases the lock when the process ends, even by a kill.
    """
    with file_in_place(path / _LOCK) as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            owner = printable(file.read(_PID_LENGTH).decode(errors="replace")).strip() or "?"
            raise OutputError(
                f"{path}: is open in another palpate desk (process {owner}); --read-only opens it, too"
            ) from error
        file.truncate(0)
        file.write(str(os.getpid()).encode())
        file.flush()
        yield file
        file.truncate(0)


class Desk:
    """Folder of fits with its history and the changes that can be undone."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.folder = FitFolder(path)
        self.history = ActionHistory(path)
        self._undo: list[tuple[Action, Sequence[Action]]] = []  # changes, each with its inverse
        self._tables: dict[str, FitTable] = {}  # by dialect of the curves' files
        self._readers: dict[str, CurveReader] = {}  # by dialect
        self.folder.rows  # noqa: B018  (an error in reading is reported before the page opens)
        self._file_states = self._present_file_states()

    def reload(self) -> None:
        """Read all files of the folder again."""
        self.folder = FitFolder(self.path)
        self._tables, self._readers = {}, {}
        self._file_states = self._present_file_states()

    def forget(self) -> None:
        """Treat the files as changed, so that they are read again."""
        self._file_states = []

    @property
    def changed_outside(self) -> bool:
        """True if another program has changed a file since the last reading."""
        return self._file_states != self._present_file_states()

    def _present_file_states(self) -> list[tuple[str, int, int]]:
        """Return name, time of change [ns] and size [bytes] of each file; empty while one of them is replaced."""
        files = sorted(file for pattern in _WATCHED_FILES for file in self.path.glob(pattern))
        with contextlib.suppress(FileNotFoundError):
            return [(file.name, (stat := file.stat()).st_mtime_ns, stat.st_size) for file in files]
        return []

    def _table(self, curve: str) -> FitTable:
        """Return the table of fits that has the rows of a curve."""
        dialect = self.folder.dialect_of(curve)
        if dialect not in self._tables:
            self._tables[dialect] = table_of(self.folder, dialect)
        return self._tables[dialect]

    def reader(self, curve: str) -> CurveReader:
        """Return the reader of a curve."""
        dialect = self.folder.dialect_of(curve)
        if dialect not in self._readers:
            self._readers[dialect] = curve_reader(self.folder, dialect)
        return self._readers[dialect]

    def curve(self, name: str) -> Curve:
        """Return a curve with its settings, by its name; raises ConfigurationError if it or its file does not exist."""
        if name not in self.folder.by_curve:
            raise ConfigurationError(f"no curve {name!r}{suggest(name, self.folder.names)}")
        if not self.folder.file_of(name):
            raise ConfigurationError(f"{name}: its file is not known: curves.csv has no column file")
        return self.folder.curve(name)

    def demand_file(self, name: str) -> None:
        """Raise ConfigurationError where the file of a curve no longer exists: its row is kept then."""
        if not Path(self.curve(name).file).is_file():
            raise ConfigurationError(f"{name}: {self.curve(name).file} is not there any more; its row is kept")

    def left(self) -> list[str]:
        """Return the names of the curves that have no row by the present settings."""
        return [name for name in self.folder.names if any(row.state != "current" for row in self.folder.rows_of(name))]

    def take_rows(self, rows: Sequence[Row]) -> list[CurveRow]:
        """Add the rows of a curve to the table, and return its present rows."""
        curve = rows[0]["curve"]
        table = self._table(curve)
        table.add(rows)
        self.folder.by_curve[curve] = [{**dict.fromkeys(table.columns, ""), **row} for row in rows]
        self._file_states = self._present_file_states()
        return self.folder.rows_of(curve)

    def compact(self) -> None:
        """Rewrite the tables without rows that later ones replace."""
        for table in self._tables.values():
            if table.path.is_file():
                table.compact(self.folder.names)
        self._file_states = self._present_file_states()

    def chosen(self, filter_words: str) -> list[str]:
        """Return the names of the curves that filter words hold; raises ConfigurationError."""
        rows = curve_filter(filter_words, self.folder, registry.load().meanings).choose(self.folder.rows)
        return list(dict.fromkeys(row.curve for row in rows))

    def mark(self, curve: str, mark: Mark, reason: str) -> Action:
        """Mark a curve; raises ConfigurationError for a rejection without a reason."""
        row = self.folder.rows_of(self.curve(curve).name)[0]
        if mark == "bad" and not reason.strip():
            raise ConfigurationError("say why the curve is rejected")
        action = _mark_action(curve, mark, reason.strip())
        is_unchanged = (row.mark, row.rejected or "") == (mark, reason if mark == "bad" else "")
        if not is_unchanged:
            self._change(action, inverse=[_mark_action(curve, row.mark, row.rejected or "")])
        return action

    def set(self, assignment: str, where: str | None) -> Action:
        """Change a setting of the curves of filter words, or of all; raises ConfigurationError."""
        options = (("--where", where),) if where is not None else ()
        action = Action("fit", (*options, ("--set", assignment), ("--no-refit", "")))
        key = assignment.partition("=")[0].strip()
        if where is None:
            inverse = setting_inverse(tomllib.loads(self.folder.settings_text()), key)
        else:
            inverse = own_inverse(self.folder.own, self.chosen(where), key)
        self._change(action, inverse)
        return action

    def set_part(self, option: Literal["tip", "model"], value: str) -> Action:
        """Replace the tip or the model of all curves; raises ConfigurationError."""
        action = Action("fit", ((f"--{option}", value), ("--no-refit", "")))
        tables = tomllib.loads(self.folder.settings_text())
        self._change(action, tip_inverse(tables) if option == "tip" else model_inverse(tables))
        return action

    def state_facts(self, answers: Mapping[str, str]) -> Action:
        """State facts of the rig, by their keys in ``rig.toml``; raises ConfigurationError."""
        statements = [(option_of(key), text) for key, text in answers.items()]
        action = Action("fit", (*statements, ("--no-refit", "")))
        demand_allowed(action)
        self._change(action, fact_inverse(self.folder.facts, answers))
        return action

    @property
    def latest(self) -> Action | None:
        """The latest change of this page that can be undone."""
        return self._undo[-1][0] if self._undo else None

    def undo(self) -> Action:
        """Undo the latest change of this page; raises ConfigurationError if there was none."""
        if not self._undo:
            raise ConfigurationError("there is nothing to undo: nothing was changed since the page was opened")
        _, inverse = self._undo[-1]
        for action in inverse:
            self._execute(action)
        self._undo.pop()
        return inverse[-1]

    def demand_no_links(self) -> None:
        """Raise OutputError for a link by which an export would leave the folder."""
        patterns = ("*", "figures/*", "figures/*/*", "maps/*")
        links = [path for pattern in patterns for path in self.path.glob(pattern) if path.is_symlink()]
        if links:
            raise OutputError(f"{links[0]}: is a link, and what the page exports stays in the folder: take it away")

    def note(self, action: Action) -> None:
        """Add an action to the history that was done by other means, such as a fit."""
        self.history.append(action)

    def _execute(self, action: Action) -> None:
        """Do an action, write it into the history, and read the changed files again."""
        self.history.demand_readable()
        with inherited_approval(self.folder.approved):  # plugin files: no question at the terminal while pages wait
            run_action(action, self.path)
        self.history.append(action)
        if action.command == "repeat review":
            self.folder.__dict__.pop("marks", None)  # a cached property
            self._file_states = self._present_file_states()
        else:
            self.reload()

    def _change(self, action: Action, inverse: Sequence[Action]) -> None:
        """Do an action, and keep it with its inverse, which was made from the former settings."""
        self._execute(action)
        if inverse:
            self._undo.append((action, inverse))


def _mark_action(curve: str, mark: str, reason: str) -> Action:
    """Return the command that marks a curve good, bad or none; the reason is of "bad"."""
    if mark == "bad":
        return Action("repeat review", (("--reject", curve), ("--reason", reason)))
    return Action("repeat review", (("--accept" if mark == "good" else "--clear", curve),))


def run_action(action: Action, path: Path) -> None:
    """Change marks or settings of a folder as the action's command does, if the gate permits it; raises UserError.

    Marks are written; any other command is called as a function, with its options as arguments.
    """
    demand_allowed(action)
    if action.command == "repeat review":
        options = dict(action.options)
        for option, mark in (("--reject", "bad"), ("--accept", "good"), ("--clear", "none")):
            if option in options:
                write_mark(path, options[option], mark, options.get("--reason", ""))  # type: ignore[arg-type]
        return
    arguments: dict[str, Any] = {}
    for option, value in action.options:
        if option in _LIST_ARGUMENTS:
            arguments.setdefault(_LIST_ARGUMENTS[option], []).append(value)
        elif option in _FACT_OPTIONS:
            arguments.setdefault("overrides", []).append(f"rig.{_FACT_OPTIONS[option]}={json.dumps(value)}")
        elif option in _TEXT_ARGUMENTS:
            arguments[_TEXT_ARGUMENTS[option]] = value
        else:  # a flag
            arguments[option.removeprefix("--").replace("-", "_")] = True
    function: Callable[..., Any] = analysis(action.command)
    with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(typer.Exit):
        function([path], **arguments)


def one_curve(name: str) -> Action:
    """Return the action that fits one curve again."""
    return Action("fit", (("--where", where_curve(name)),))
