"""Logs that are read alike, such as the curves of a folder: one pipeline is for all of them."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Generic, TypeVar

from palpate import ConfigurationError, LogError, UserError
from palpate_engine import Registry
from palpate_records.recording import Suggestion
from palpate_records.tables.csv_sheet import record_tables
from palpate_records.tables.table_text import OTHER_SUFFIXES, SUFFIXES
from palpate_records.tables.workbook import WORKBOOKS, record_sheets

from palpate_kit.curves.curve_list import is_list
from palpate_kit.curves.curve_table import SETTINGS
from palpate_kit.logs.draft_pipeline import UNREAD, readers_of

Log = TypeVar("Log", bound="Path | LogPart")


@dataclass(frozen=True)
class LogPart:
    """A log, or a part of one that is a record by itself: a sheet of a workbook, one of several tables of a text."""

    path: Path
    part: str | None = None
    keys: tuple[tuple[str, str], ...] = ()  # of the device that reads that part alone

    def __str__(self) -> str:
        return str(self.path) if self.part is None else f"{self.path}:{self.part}"

    @property
    def name(self) -> str:
        """Of the file, and of its part."""
        return self.path.name if self.part is None else f"{self.path.name}:{self.part}"


def specimens_of(log: Path) -> list[LogPart]:
    """The records of a log: the sheets of a workbook that hold numbers, the tables of a text; one, else the log."""
    name = log.name.lower()
    parts: list[LogPart] = []
    with suppress(LogError):  # whoever reads it says so
        if name.endswith(WORKBOOKS):
            parts = [LogPart(log, sheet, (("sheet", sheet),)) for sheet in record_sheets(log)]
        elif name.endswith((*SUFFIXES, *OTHER_SUFFIXES)):
            parts = [LogPart(log, title, (("header", str(line)),)) for line, title in record_tables(log)]
    return parts if len(parts) > 1 else [LogPart(log)]


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
        key = json.dumps([{**suggestion.device, "file": ""}, suggestion.alignment], default=str)
        groups.setdefault(key, AlikeLogs(suggestion)).logs.append(log)
    return sorted(groups.values(), key=lambda group: -len(group.logs))


def logs_among(sources: Sequence[Path], known: Registry) -> list[Path]:
    """The files, and of folders all that hold records and palpate did not write; raises ConfigurationError."""
    readers = readers_of(known).values()
    found: list[Path] = []
    for source in sources:
        if not source.exists():
            raise ConfigurationError(f"{source}: there is no such file or folder")
        if source.is_dir():
            own = {settings.parent for settings in source.rglob(SETTINGS)}
            files = [path for path in sorted(source.rglob("*")) if path.is_file() and not own & {*path.parents}]
            files = [path for path in files if not is_list(path)]
            found += [
                path for path in files if path.suffix.lower() in UNREAD or any(r.recognises(path) for r in readers)
            ]
        else:
            found.append(source)
    if not found:
        raise ConfigurationError(f"{', '.join(map(str, sources))}: holds no file that palpate can read")
    return list(dict.fromkeys(found))


def differences(one: Suggestion, other: Suggestion) -> list[str]:
    """The keys in which the readers of two logs differ."""
    mine, theirs = (_flat({**s.device, "file": "", "alignment": dict(s.alignment)}) for s in (one, other))
    return [key for key in {**mine, **theirs} if mine.get(key) != theirs.get(key)]


def _flat(table: dict[str, object], head: str = "") -> dict[str, object]:
    found: dict[str, object] = {}
    for key, value in table.items():
        found |= _flat(value, f"{head}{key}.") if isinstance(value, dict) else {f"{head}{key}": value}
    return found
