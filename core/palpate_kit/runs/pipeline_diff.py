"""How two pipelines differ that should be one."""

from __future__ import annotations

import tomllib
from collections.abc import Collection, Iterator
from typing import Any

from palpate_engine import toml_tables

_SHOWN = 5  # differences in a message


def differences(now: str, before: str, ignored: Collection[str] = ()) -> str:
    """In words, which settings of a resolved pipeline are not those of another; empty where none differs.

    `ignored` names tables, or keys such as ``run.seed``, that may differ.
    """
    first, second = (_settings(text) for text in (now, before))
    told = [
        f"{name} is {_shown(first.get(name))}, was {_shown(second.get(name))}"
        for name in sorted(first.keys() | second.keys())
        if first.get(name) != second.get(name)
        and not any(name == known or name.startswith(f"{known}.") for known in ignored)
    ]
    more = f"; and {len(told) - _SHOWN} more" if len(told) > _SHOWN else ""
    return "; ".join(told[:_SHOWN]) + more


def _settings(text: str) -> dict[str, Any]:
    try:
        return dict(_flat(toml_tables(text), ()))
    except tomllib.TOMLDecodeError:
        return {"pipeline": "unreadable"}


def _flat(table: dict[str, Any], above: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    for key, value in table.items():
        if isinstance(value, dict):
            yield from _flat(value, (*above, key))
        elif value != []:  # an empty list counts as a missing key, as of a later version
            yield ".".join((*above, key)), value


def _shown(value: Any) -> str:
    text = "not given" if value is None else repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
