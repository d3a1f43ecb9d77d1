"""What the page shows, and what it asks for done: files of the folder, and the commands that would do the same."""

from __future__ import annotations

import contextlib
import fcntl
import io
import json
import os
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, Any

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
_FILES = ("fits.csv", "curves.csv", "own.toml", "review.json", "pipeline*.toml", RIG)
_LISTS = {"--set": "overrides", "--unset": "unset", "--reject": "reject", "--accept": "accept", "--clear": "clear"}
_FACTS = {option_of(key): key for key in FACT_KEYS}
_WORDS = {"--where": "where", "--tip": "tip", "--model": "model", "--reason": "reason"}


@contextlib.contextmanager
def writing(path: Path) -> Iterator[IO[bytes]]:
    """The lock of a folder, for one page program at a time; a kill opens it. Raises OutputError."""
    with file_in_place(path / _LOCK) as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            other = f"(process {printable(file.read(20).decode(errors='replace')).strip() or '?'})"
            raise OutputError(f"{path}: is open in another palpate desk {other}; --read-only opens it, too") from error
        file.truncate(0)
        file.write(str(os.getpid()).encode())
        file.flush()
        yield file
        file.truncate(0)


class Desk:
    """A folder of fits, as it is now."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.folder = FitFolder(path)
        self.history = ActionHistory(path)
        self._undo: list[tuple[Action, Sequence[Action]]] = []  # what was done here, with what undoes it
        self._tables: dict[str, FitTable] = {}
        self._readers: dict[str, CurveReader] = {}
        self.folder.rows  # noqa: B018  (what cannot be read is reported before the page opens)
        self._stamp = self._signature()

    def reload(self) -> None:
        """Read everything again."""
        self.folder = FitFolder(self.path)
        self._tables, self._readers = {}, {}
        self._stamp = self._signature()

    def forget(self) -> None:
        """Take every file for changed."""
        self._stamp = []

    @property
    def changed_outside(self) -> bool:
        """True if another program has changed a file since."""
        return self._stamp != self._signature()

    def _signature(self) -> list[tuple[str, int, int]]:
        files = sorted(file for pattern in _FILES for file in self.path.glob(pattern))
        with contextlib.suppress(FileNotFoundError):  # it is being replaced
            return [(file.name, (stat := file.stat()).st_mtime_ns, stat.st_size) for file in files]
        return []

    def _table(self, curve: str) -> FitTable:
        name = self.folder.dialect_of(curve)
        if name not in self._tables:
            self._tables[name] = table_of(self.folder, name)
        return self._tables[name]

    def reader(self, curve: str) -> CurveReader:
        """How a curve is read."""
        name = self.folder.dialect_of(curve)
        if name not in self._readers:
            self._readers[name] = curve_reader(self.folder, name)
        return self._readers[name]

    def curve(self, name: str) -> Curve:
        """Return a curve with its settings, by its name; raises ConfigurationError if it or its file does not exist."""
        if name not in self.folder.by_curve:
            raise ConfigurationError(f"no curve {name!r}{suggest(name, self.folder.names)}")
        if not self.folder.file_of(name):
            raise ConfigurationError(f"{name}: its file is not known: curves.csv has no column file")
        return self.folder.curve(name)

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
        """Rewrite the table where it holds rows that later ones stand for."""
        for table in self._tables.values():
            if table.path.is_file():
                table.compact(self.folder.names)
        self._stamp = self._signature()

    def chosen(self, words: str) -> list[str]:
        """Names of the curves that filter words hold; raises ConfigurationError."""
        rows = curve_filter(words, self.folder, registry.load().meanings).choose(self.folder.rows)
        return list(dict.fromkeys(row.curve for row in rows))

    def mark(self, curve: str, mark: Mark, reason: str) -> Action:
        """Mark a curve; raises ConfigurationError for a rejection without a reason."""
        row = self.folder.rows_of(self.curve(curve).name)[0]
        if mark == "bad" and not reason.strip():
            raise ConfigurationError("say why the curve is rejected")
        action = _mark_action(curve, mark, reason.strip())
        if (row.mark, row.rejected or "") == (mark, reason if mark == "bad" else ""):
            return action
        self._change(action, [_mark_action(curve, row.mark, row.rejected or "")])
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

    def set_part(self, kind: str, value: str) -> Action:
        """Put another tip or model in place for all curves; raises ConfigurationError."""
        action = Action("fit", ((f"--{kind}", value), ("--no-refit", "")))
        tables = tomllib.loads(self.folder.settings_text())
        self._change(action, tip_inverse(tables) if kind == "tip" else model_inverse(tables))
        return action

    def state_facts(self, answers: Mapping[str, str]) -> Action:
        """State facts of the rig, by their keys in ``rig.toml``; raises ConfigurationError."""
        action = Action("fit", (*((option_of(key), text) for key, text in answers.items()), ("--no-refit", "")))
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
            self._do(action)
        self._undo.pop()
        return inverse[-1]

    def demand_no_links(self) -> None:
        """Raise OutputError where what is exported would leave the folder by a link."""
        places = [place for pattern in ("*", "figures/*", "figures/*/*", "maps/*") for place in self.path.glob(pattern)]
        if link := next((place for place in places if place.is_symlink()), None):
            raise OutputError(f"{link}: is a link, and what the page exports stays in the folder: take it away")

    def note(self, action: Action) -> None:
        """Add to the history what was done without any change of settings."""
        self.history.append(action)

    def _do(self, action: Action) -> None:
        """Do what a command does, then write it into the history."""
        self.history.demand_readable()
        with inherited_approval(self.folder.approved):  # nobody is asked at the terminal while pages wait
            run_action(action, self.path)
        self.history.append(action)
        if action.command == "repeat review":
            self.folder.__dict__.pop("marks", None)
            self._stamp = self._signature()
        else:
            self.reload()

    def _change(self, action: Action, inverse: Sequence[Action]) -> None:
        """Do what a command does; what undoes it was found from what is there before."""
        self._do(action)
        if inverse:
            self._undo.append((action, inverse))


def _mark_action(curve: str, mark: str, reason: str) -> Action:
    if mark == "bad":
        return Action("repeat review", (("--reject", curve), ("--reason", reason)))
    return Action("repeat review", (("--accept" if mark == "good" else "--clear", curve),))


def run_action(action: Action, path: Path) -> None:
    """Do what a command that changes marks or settings does, if the gate lets it pass; raises UserError."""
    demand_allowed(action)
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
        elif option in _FACTS:
            arguments.setdefault("overrides", []).append(f"rig.{_FACTS[option]}={json.dumps(value)}")
        elif option in _WORDS:
            arguments[_WORDS[option]] = value
        else:
            arguments[option.removeprefix("--").replace("-", "_")] = True
    function: Callable[..., Any] = analysis(action.command)
    with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(typer.Exit):
        function([path], **arguments)


def one_curve(name: str) -> Action:
    """Return the command that fits one curve again."""
    return Action("fit", (("--where", where_curve(name)),))
