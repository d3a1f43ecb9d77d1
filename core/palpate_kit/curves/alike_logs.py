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
        """The name of the file, followed by that of its record where it holds several."""
        return self.path.name if self.part is None else f"{self.path.name}:{self.part}"

    @property
    def curve(self) -> Curve:
        """The curve in it."""
        return Curve(str(self), str(self.path.resolve()), record=self.part, place=self.place)

    @property
    def choices(self) -> dict[str, str]:
        """The choices by which a device reads that record alone."""
        return {} if self.part is None else {RECORD: self.part}


def specimens_of(log: Path, registry: Registry, choices: Mapping[str, str] = {}) -> list[LogPart]:
    """Return the records of a log that holds several by themselves, else the log."""
    if RECORD not in choices:
        with suppress(LogError):  # a log that cannot be read is one record: its fit reports the error
            reader = recording_of(log, registry)
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
    """Return groups of logs with equal devices and alignments, the largest group first.

    `suggest` finds how a log is read. A log that `suggest` cannot read is entered in `refused`, with its error.
    """
    groups: dict[str, AlikeLogs[Log]] = {}
    for log in logs:
        try:
            suggestion = suggest(log)
        except UserError as error:
            refused[str(log)] = str(error).removeprefix(f"{getattr(log, 'path', log)}: ")
            continue
        # Logs are read alike if their suggestions differ in nothing but the file and its record.
        key = json.dumps([{**suggestion.device, "file": "", RECORD: ""}, suggestion.alignment], default=str)
        groups.setdefault(key, AlikeLogs(suggestion)).logs.append(log)
    return sorted(groups.values(), key=lambda group: -len(group.logs))


def logs_among(sources: Sequence[Path], registry: Registry) -> list[Path]:
    """Return the files among the sources, and those in the folders among them that hold records.

    Left out are those that palpate wrote itself: folders of fits, and lists of curves. `registry` has the devices of
    all plugins, by which a file can be read. Raises ConfigurationError for a source that does not exist, and if no file
    remains.
    """
    logs: list[Path] = []
    for source in sources:
        if not source.exists():
            raise ConfigurationError(f"{source}: no such file or folder")
        if source.is_dir():
            fit_folders = {settings.parent for settings in source.rglob(SETTINGS)}
            # Folders of fits within the sources hold no logs, and lists name curves.
            for path in log_paths(source, lambda path: _holds_records(path, registry)):
                if not fit_folders & {*path.parents} and not is_list(path):
                    logs.append(path)
        else:
            logs.append(source)
    if not logs:
        raise ConfigurationError(f"{', '.join(map(str, sources))}: holds no file that palpate can read")
    return list(dict.fromkeys(logs))


def log_paths(folder: Path, is_log: Callable[[Path], bool]) -> Iterator[Path]:
    """Yield the logs in a folder in the order of their names, or the folder alone if it is a log itself.

    A folder in it that is a log, such as a bag, counts as one, and its files do not.
    """
    if _is_folder_log(folder, is_log):
        yield folder
        return
    folder_logs = set[Path]()
    for path in sorted(folder.rglob("*")):
        if folder_logs & {*path.parents}:
            continue
        if path.is_dir():
            if _is_folder_log(path, is_log):
                folder_logs.add(path)
                yield path
        elif is_log(path):
            yield path


def _is_folder_log(path: Path, is_log: Callable[[Path], bool]) -> bool:
    """Return True if a folder is a log, and not merely a folder with one log in it."""
    return is_log(path) and sum(map(is_log, path.iterdir())) != 1


def _holds_records(path: Path, registry: Registry) -> bool:
    """Return True for a log, and for a file whose ending says that it holds records which no device reads."""
    is_unread = path.is_file() and path.suffix.lower() in UNREAD
    return is_unread or reader_of(path, registry) is not None


def differences(first: Suggestion, second: Suggestion) -> list[str]:
    """Return the keys in which the readers of two logs differ, files and records left out."""
    first_keys, second_keys = (
        _dotted_keys({**suggestion.device, "file": "", RECORD: "", "alignment": dict(suggestion.alignment)})
        for suggestion in (first, second)
    )
    return [key for key in {**first_keys, **second_keys} if first_keys.get(key) != second_keys.get(key)]


def _dotted_keys(table: dict[str, object], prefix: str = "") -> dict[str, object]:
    """Return the values of nested tables by their keys, joined by dots."""
    values: dict[str, object] = {}
    for key, value in table.items():
        if isinstance(value, dict):
            values |= _dotted_keys(value, f"{prefix}{key}.")
        else:
            values[f"{prefix}{key}"] = value
    return values
