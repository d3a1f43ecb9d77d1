"""Logs that are read alike, such as the curves of a folder: one pipeline is for all of them."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Generic, TypeVar

from palpate import ConfigurationError, LogError, UserError
from palpate_engine import Registry
from palpate_records.recording import Suggestion

from palpate_kit.curves.curve import Curve
from palpate_kit.curves.curve_list import RECORD, is_list
from palpate_kit.curves.folder_settings import SETTINGS
from palpate_kit.logs.draft_pipeline import UNREAD, reader_of, recording_of

Log = TypeVar("Log", bound="Path | LogPart")


@dataclass(frozen=True)
class LogPart:
    """A log, or one of several records in it."""

    path: Path
    part: str | None = None
    place: tuple[float, float] | None = None  # x and y [m] that the log states of it

    def __str__(self) -> str:
        return str(self.path) if self.part is None else f"{self.path}:{self.part}"

    @property
    def name(self) -> str:
        """Of the file, and of its part."""
        return self.path.name if self.part is None else f"{self.path.name}:{self.part}"

    @property
    def curve(self) -> Curve:
        """The curve in it."""
        return Curve(str(self), str(self.path.resolve()), record=self.part, place=self.place)

    @property
    def choices(self) -> dict[str, str]:
        """What makes a device read that record alone."""
        return {} if self.part is None else {RECORD: self.part}


def specimens_of(log: Path, known: Registry, choices: Mapping[str, str] = {}) -> list[LogPart]:
    """Return the records of a log that holds several by themselves, else the log."""
    if RECORD not in choices:
        with suppress(LogError):  # whoever reads it says so
            reader = recording_of(log, known)
            if names := reader.records(log, choices):
                places = reader.places(log)
                return [LogPart(log, name, places.get(name)) for name in names]
    return [LogPart(log)]


@dataclass
class AlikeLogs(Generic[Log]):
    """Logs that one reader reads."""

    suggestion: Suggestion  # of the first of them
    logs: list[Log] = field(default_factory=list)


def alike_logs(
    logs: Iterable[Log], suggest: Callable[[Log], Suggestion], refused: dict[str, str]
) -> list[AlikeLogs[Log]]:
    """Groups of logs with equal devices and alignments, the largest first; `refused` takes the others and why."""
    groups: dict[str, AlikeLogs[Log]] = {}
    for log in logs:
        try:
            suggestion = suggest(log)
        except UserError as error:
            refused[str(log)] = str(error).removeprefix(f"{getattr(log, 'path', log)}: ")
            continue
        key = json.dumps([{**suggestion.device, "file": "", RECORD: ""}, suggestion.alignment], default=str)
        groups.setdefault(key, AlikeLogs(suggestion)).logs.append(log)
    return sorted(groups.values(), key=lambda group: -len(group.logs))


def logs_among(sources: Sequence[Path], known: Registry) -> list[Path]:
    """Return the files, and of folders all that hold records and palpate did not write; raises ConfigurationError."""
    found: list[Path] = []
    for source in sources:
        if not source.exists():
            raise ConfigurationError(f"{source}: no such file or folder")
        if source.is_dir():
            own = {settings.parent for settings in source.rglob(SETTINGS)}
            paths = log_paths(source, lambda path: _holds_records(path, known))
            found += [path for path in paths if not own & {*path.parents} and not is_list(path)]
        else:
            found.append(source)
    if not found:
        raise ConfigurationError(f"{', '.join(map(str, sources))}: holds no file that palpate can read")
    return list(dict.fromkeys(found))


def log_paths(folder: Path, is_log: Callable[[Path], bool]) -> Iterator[Path]:
    """Yield the logs in a folder by their names, those that are folders themselves as one; the folder, where it is
    one."""
    folders = {folder} if _is_folder_log(folder, is_log) else set[Path]()
    yield from folders
    for path in [] if folders else sorted(folder.rglob("*")):
        if folders & {*path.parents}:
            continue
        if path.is_dir():
            if not _is_folder_log(path, is_log):
                continue
            folders.add(path)
            yield path
        elif is_log(path):
            yield path


def _is_folder_log(path: Path, is_log: Callable[[Path], bool]) -> bool:
    """Return True if a folder is a log that is more than its one file."""
    return is_log(path) and sum(map(is_log, path.iterdir())) != 1


def _holds_records(path: Path, known: Registry) -> bool:
    unread = path.is_file() and path.suffix.lower() in UNREAD
    return unread or reader_of(path, known) is not None


def differences(one: Suggestion, other: Suggestion) -> list[str]:
    """Return the keys in which the readers of two logs differ."""
    mine, theirs = (_flat({**s.device, "file": "", RECORD: "", "alignment": dict(s.alignment)}) for s in (one, other))
    return [key for key in {**mine, **theirs} if mine.get(key) != theirs.get(key)]


def _flat(table: dict[str, object], head: str = "") -> dict[str, object]:
    found: dict[str, object] = {}
    for key, value in table.items():
        found |= _flat(value, f"{head}{key}.") if isinstance(value, dict) else {f"{head}{key}": value}
    return found
