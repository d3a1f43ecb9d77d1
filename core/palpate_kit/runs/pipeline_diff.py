"""Differences of two pipelines that should be one."""

from __future__ import annotations

import tomllib
from collections.abc import Collection, Iterator
from typing import Any

from palpate_engine import toml_tables

_SHOWN = 5  # differences in a message: a choice
_MAX_LENGTH = 60  # characters of a value in a message: a choice


def differences(now: str, before: str, ignored: Collection[str] = ()) -> str:
    """Return in words which settings of a resolved pipeline are not those of another; empty where none differs.

    `ignored` names tables, or keys such as ``run.seed``, that may differ.
    """
    first, second = (_settings(text) for text in (now, before))
    sentences = []
    for name in sorted(first.keys() | second.keys()):
        is_ignored = any(name == key or name.startswith(f"{key}.") for key in ignored)
        if first.get(name) != second.get(name) and not is_ignored:
            sentences.append(f"{name} is {_short_text(first.get(name))}, was {_short_text(second.get(name))}")
    more = f"; and {len(sentences) - _SHOWN} more" if len(sentences) > _SHOWN else ""
    return "; ".join(sentences[:_SHOWN]) + more


def _settings(text: str) -> dict[str, Any]:
    """Return the settings of a pipeline by their dotted keys; a single one of a text that is not TOML."""
    try:
        return dict(_flat(toml_tables(text), ()))
    except tomllib.TOMLDecodeError:
        return {"pipeline": "unreadable"}


def _flat(table: dict[str, Any], above: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    """Yield dotted keys and values of tables within tables."""
    for key, value in table.items():
        if isinstance(value, dict):
            yield from _flat(value, (*above, key))
        elif value != []:  # an empty list counts as a missing key, as of a later version
            yield ".".join((*above, key)), value


def _short_text(value: Any) -> str:
    """Return a value as a message shows it, cut where it is long."""
    text = "not given" if value is None else repr(value)
    return text if len(text) <= _MAX_LENGTH else f"{text[: _MAX_LENGTH - len('...')]}..."
