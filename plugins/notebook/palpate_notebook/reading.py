"""Records from logs: what `palpate info --suggest` finds out, as a record."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from palpate import ConfigurationError
from palpate.host import carried_by, replay_source, suggestion_of

from palpate_notebook.records import Record, declared

_ROLES = {"height": "position"}


def read(
    path: str | Path,
    signals: Mapping[str, str] | None = None,
    *,
    timing: str | float | None = None,
    delay: str | float | Mapping[str, str | float] | None = None,
    sign: int | Mapping[str, int] | None = None,
    tip_mass: str | float | None = None,
    tare: str | float | None = None,
    alignment: Mapping[str, Any] | None = None,
) -> Record:
    """A record from a log: .mcap, .db3, a bag folder, .csv, or a run folder.

    A log that palpate has written says itself what its signals are. Of others, `signals` settles what is what, as in
    ``{"force": "/wrench:wrench.force.z", "height": "z", "rate": "500 Hz"}``; the rest is found by what the numbers do
    together, and what is only a guess is warned of. All else as in `palpate.record`.

    Raises LogError for what is no log, ConfigurationError where something must be said that no file can say.
    """
    log = Path(path)
    choices = {_ROLES.get(role, role): text for role, text in (signals or {}).items()}
    carried = carried_by(log) if not choices else None
    if carried is not None:
        tables = replay_source(carried).tables
        devices, channels = tables["device"], dict(tables["alignment"])
        doubts: tuple[str, ...] = ()
    else:
        suggestion = suggestion_of(log, choices)
        if suggestion.blanks:
            raise ConfigurationError(f"{log}: {'; '.join(suggestion.blanks)}: say it in signals={{...}}")
        devices = {"log": {**suggestion.device, "file": str(log.absolute())}}
        channels, doubts = dict(suggestion.alignment), suggestion.doubts
        for text in doubts:
            warnings.warn(f"{log.name}: {text}", stacklevel=2)
    roles = {role: channels.pop(role) for role in list(channels) if _is_signal(role, channels[role])}
    table = channels | declared(roles, timing, delay, sign, tip_mass, tare, alignment)
    return Record(log.name, devices, table, log, doubts)


def _is_signal(role: str, value: Any) -> bool:
    named = ("force", "position", "velocity", "measuring", "lateral_x", "lateral_y")
    return role in named and isinstance(value, str | dict)
