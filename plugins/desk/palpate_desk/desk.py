"""What the page shows, and what it asks for done: files of the folder, and the commands that would do the same."""

from __future__ import annotations

import contextlib
import fcntl
import io
import os
import tomllib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import IO, Any

import typer
from palpate import ConfigurationError, OutputError, suggest
from palpate_engine import analysis, registry
from palpate_kit.curves.curve_files import Curve
from palpate_kit.curves.curve_filter import curve_filter
from palpate_kit.curves.curve_fits import CurveReader, Row, offline
from palpate_kit.curves.curve_table import FitTable
from palpate_kit.curves.fit_folder import CurveRow, FitFolder
from palpate_kit.runs.review_file import Mark, write_mark

from palpate_desk.history_file import Action, ActionHistory, actions_of, where_curve
from palpate_desk.page_messages import demand_allowed, demand_no_file
from palpate_desk.settings_undo import model_inverse, own_inverse, setting_inverse, tip_inverse

_LOCK = ".desk.lock"
_FILES = ("fits.csv", "curves.csv", "own.toml", "review.json", "pipeline*.toml")
_LISTS = {"--set": "overrides", "--unset": "unset", "--reject": "reject", "--accept": "accept", "--clear": "clear"}
_WORDS = {"--where": "where", "--tip": "tip", "--model": "model", "--reason": "reason"}


@contextlib.contextmanager
def writing(path: Path) -> Iterator[IO[str]]:
    """The lock of a folder, for one page program at a time; a kill opens it. Raises OutputError."""
    try:
        file = (path / _LOCK).open("a+")
    except OSError as error:
        raise OutputError(f"{path / _LOCK}: cannot write: {error.strerror}; --read-only needs no lock") from error
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            file.seek(0)
            other = f"(process {file.read().strip() or '?'})"
            raise OutputError(f"{path}: is open in another palpate desk {other}; --read-only opens it, too") from error
        file.truncate(0)
        file.write(str(os.getpid()))
        file.flush()
        yield file
        file.truncate(0)


class Desk:
    """A folder of fits, as it is now."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.folder = FitFolder(path)
        self.history = ActionHistory(path)
        self._tables: dict[str, FitTable] = {}
        self._readers: dict[str, CurveReader] = {}
        self.folder.rows  # noqa: B018  (what cannot be read is told before the page is there)
        self._stamp = self._signature()

    def reload(self) -> None:
        """Read everything anew."""
        self.folder = FitFolder(self.path)
        self._tables, self._readers = {}, {}
        self._stamp = self._signature()

    @property
    def changed_outside(self) -> bool:
        """Whether another program has changed a file since."""
        return self._stamp != self._signature()

    def _signature(self) -> list[tuple[str, int, int]]:
        files = sorted(file for pattern in _FILES for file in self.path.glob(pattern))
        with contextlib.suppress(FileNotFoundError):  # it is being replaced
            return [(file.name, (stat := file.stat()).st_mtime_ns, stat.st_size) for file in files]
        return []

    def _table(self, curve: str) -> FitTable:
        name = self.folder.pipeline_of(curve)
        if name not in self._tables:
            self._tables[name] = FitTable(
                self.path, offline(self.folder.pipeline(name)), self.reader(curve).device, name
            )
        return self._tables[name]

    def reader(self, curve: str) -> CurveReader:
        """How a curve is read."""
        name = self.folder.pipeline_of(curve)
        if name not in self._readers:
            self._readers[name] = self.folder.reader(name)
        return self._readers[name]

    def curve(self, name: str) -> Curve:
        """A curve with its settings, by its name; raises ConfigurationError where there is none, or no file of it."""
        if name not in self.folder.by_curve:
            raise ConfigurationError(f"there is no curve {name!r}{suggest(name, self.folder.names)}")
        file = self.folder.entries.get(name, {}).get("file", "")
        if not file:
            raise ConfigurationError(f"{name}: its file is not known: curves.csv has no column file")
        return Curve(name, file, own=self.folder.own.get(name, ()))

    def demand_file(self, name: str) -> None:
        """Raise ConfigurationError where the file of a curve has gone, so that its row stays."""
        if not Path(self.curve(name).file).is_file():
            raise ConfigurationError(f"{name}: {self.curve(name).file} is not there any more; its row is kept")

    def left(self) -> list[str]:
        """Names of the curves that have no row by the present settings."""
        return [name for name in self.folder.names if any(row.state != "current" for row in self.folder.rows_of(name))]

    def take_rows(self, rows: Sequence[Row]) -> list[CurveRow]:
        """Add the rows of a curve to the table; what it has now."""
        name = rows[0]["curve"]
        table = self._table(name)
        table.add(rows)
        self.folder.by_curve[name] = [{**dict.fromkeys(table.columns, ""), **row} for row in rows]
        self._stamp = self._signature()
        return self.folder.rows_of(name)

    def compact(self) -> None:
        """Write the table anew where it holds rows that later ones stand for."""
        for table in self._tables.values():
            table.compact(self.folder.names)
        self._stamp = self._signature()

    def chosen(self, words: str) -> list[str]:
        """Names of the curves that filter words hold; raises ConfigurationError."""
        rows = curve_filter(words, self.folder, registry.load().meanings).choose(self.folder.rows)
        return list(dict.fromkeys(row.curve for row in rows))

    def mark(self, curve: str, mark: Mark, reason: str) -> Action:
        """Mark a curve; raises ConfigurationError for a rejection without a reason."""
        row = self.folder.rows_of(self.curve(curve).name)[0]
        action = _mark_action(curve, mark, reason)
        if (row.mark, row.rejected or "") == (mark, reason if mark == "bad" else ""):
            return action
        self._do(action, [_mark_action(curve, row.mark, row.rejected or "")])
        return action

    def set(self, assignment: str, where: str | None) -> Action:
        """Change a setting of the curves of filter words, or of all; raises ConfigurationError."""
        demand_allowed(assignment)
        options = (("--where", where),) if where is not None else ()
        action = Action("fit", (*options, ("--set", assignment), ("--no-refit", "")))
        key = assignment.partition("=")[0].strip()
        if where is None:
            inverse = setting_inverse(tomllib.loads(self.folder.settings_text()), key)
        else:
            inverse = own_inverse(self.folder.own, self.chosen(where), key)
        self._do(action, inverse)
        return action

    def set_part(self, kind: str, value: str) -> Action:
        """Put another tip or model in place for all curves; raises ConfigurationError."""
        demand_no_file(value)
        action = Action("fit", ((f"--{kind}", value), ("--no-refit", "")))
        tables = tomllib.loads(self.folder.settings_text())
        self._do(action, tip_inverse(tables) if kind == "tip" else model_inverse(tables))
        return action

    def undo(self) -> Action:
        """Take the latest change back; raises ConfigurationError where there is none."""
        latest = self.history.latest
        if latest is None:
            raise ConfigurationError("there is nothing to undo")
        actions = list(actions_of(latest.inverse))
        for action in actions:
            self._do(action, (), latest.number)
        return actions[-1]

    def note(self, action: Action) -> None:
        """Add to the history what was done without any change of settings."""
        self.history.append(action)

    def _do(self, action: Action, inverse: Sequence[Action], undoes: int | None = None) -> None:
        """Do what a command does, then write it into the history."""
        run_action(action, self.path)
        self.history.append(action, inverse, undoes)
        if action.command == "repeat review":
            self.folder.__dict__.pop("marks", None)
            self._stamp = self._signature()
        else:
            self.reload()


def _mark_action(curve: str, mark: str, reason: str) -> Action:
    if mark == "bad":
        if not reason.strip():
            raise ConfigurationError("say why the curve is rejected")
        return Action("repeat review", (("--reject", curve), ("--reason", reason.strip())))
    return Action("repeat review", (("--accept" if mark == "good" else "--clear", curve),))


def run_action(action: Action, path: Path) -> None:
    """Do what a command of the history does; raises UserError."""
    if action.command == "repeat review":
        options = dict(action.options)
        for option, mark in (("--reject", "bad"), ("--accept", "good"), ("--clear", "none")):
            if option in options:
                write_mark(path, options[option], mark, options.get("--reason", ""))  # type: ignore[arg-type]
        return
    arguments: dict[str, Any] = {}
    for option, value in action.options:
        if option in _LISTS:
            arguments.setdefault(_LISTS[option], []).append(value)
        elif option in _WORDS:
            arguments[_WORDS[option]] = value
        else:
            arguments[option.removeprefix("--").replace("-", "_")] = True
    function: Callable[..., Any] = analysis(action.command)
    with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(typer.Exit):
        function([path], **arguments)


def one_curve(name: str) -> Action:
    """The command that fits one curve anew."""
    return Action("fit", (("--where", where_curve(name)),))
