"""Logs that are read alike, such as the curves of a folder: one pipeline is for all of them."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from palpate import ConfigurationError, UserError
from palpate_engine import Registry
from palpate_records.recording import Suggestion

from palpate_kit.curves.curve_list import is_list
from palpate_kit.curves.curve_table import SETTINGS
from palpate_kit.logs.draft_pipeline import readers_of


@dataclass
class AlikeLogs:
    """Logs that one reader reads."""

    suggestion: Suggestion  # of the first of them
    logs: list[Path] = field(default_factory=list)


def alike_logs(logs: Iterable[Path], suggest: Callable[[Path], Suggestion], refused: dict[str, str]) -> list[AlikeLogs]:
    """Groups of logs with equal devices and alignments, the largest first; `refused` takes the others and why."""
    groups: dict[str, AlikeLogs] = {}
    for log in logs:
        try:
            suggestion = suggest(log)
        except UserError as error:
            refused[str(log)] = str(error).removeprefix(f"{log}: ")
            continue
        key = json.dumps([{**suggestion.device, "file": ""}, suggestion.alignment], default=str)
        groups.setdefault(key, AlikeLogs(suggestion)).logs.append(log)
    return sorted(groups.values(), key=lambda group: -len(group.logs))


def logs_among(sources: Sequence[Path], known: Registry) -> list[Path]:
    """The files, and of folders all that a device reads and palpate did not write; raises ConfigurationError."""
    readers = readers_of(known).values()
    found: list[Path] = []
    for source in sources:
        if not source.exists():
            raise ConfigurationError(f"{source}: there is no such file or folder")
        if source.is_dir():
            own = {settings.parent for settings in source.rglob(SETTINGS)}
            files = [path for path in sorted(source.rglob("*")) if path.is_file() and not own & {*path.parents}]
            files = [path for path in files if not is_list(path)]
            found += [path for path in files if any(reader.recognises(path) for reader in readers)]
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
