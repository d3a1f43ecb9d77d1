"""The gate that every command of the page passes: which there are, and which settings and marks they may name."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache, partial
from pathlib import PurePath
from typing import Any, get_args

from palpate import ConfigurationError, Settings
from palpate_engine import (
    AlignmentSettings,
    facts_of,
    facts_stated,
    option_of,
    parsed_assignment,
    registry,
    tip_values,
)

from palpate_desk.action import OUT, Action

_PARTS = ("estimator", "indenter", "model")
_TABLES = ("alignment", *_PARTS)  # that name no code
_RIG = "rig"  # of the facts
FACT_KEYS = tuple(facts_stated().values())  # that the page asks for
_BARE = re.compile(r"[\w-]+")  # a key
_PICTURE = re.compile(rf"{re.escape(OUT)}/groups\.svg")
_PIPELINE = re.compile(rf"{re.escape(OUT)}/pipeline[^/]*\.toml")
_FIGURES = re.compile(rf"{re.escape(OUT)}/figures/[^/]+")


def demand_allowed(action: Action) -> None:
    """Raise ConfigurationError for what is not a command of the page, or names a file, code or a device."""
    known = _KNOWN.get((action.command, action.source == OUT), {})
    for option, value in action.options:
        if option not in known:
            raise ConfigurationError(f"palpate {action.command} {option}: is not a command of the page")
        known[option](value)
    given = {option for option, _ in action.options}
    if not known or (action.command == "repeat review" and len(given & _MARKS) != 1):
        raise ConfigurationError(f"palpate {action.command}: is not a command of the page")


def is_change(action: Action) -> bool:
    """Return True if a command changes marks, settings or fits of a folder, or begins one: what its history consists
    of."""
    given = dict(action.options)
    begins = "--tip" in given and "--pipeline" not in given and given.get("--out") == OUT  # it names no pipeline
    return action.command in ("fit", "repeat review") and (action.source == OUT or begins)


def demand_allowed_setting(assignment: str) -> None:
    """Raise ConfigurationError for a setting that the page may not change: of a file, a plugin, a device."""
    keys, value = parsed_assignment(assignment)
    if keys[0] == _RIG:
        _demand_fact(".".join(keys[1:]), value)
        return
    _demand_table(keys[0], assignment)
    if not all(map(_BARE.fullmatch, keys)):
        raise ConfigurationError(f"{assignment!r}: its key has signs that no name of a setting has")
    _demand_no_file({*keys, *_keys_of(value)}, assignment)


def _demand_key(key: str) -> None:
    table, _, name = key.partition(".")
    if table != _RIG or name not in FACT_KEYS:
        _demand_table(table.strip(), key)


def _demand_fact(key: str, value: Any) -> None:
    """Raise ConfigurationError for anything but a fact that the page asks for: none of these names a file."""
    if key not in FACT_KEYS:
        raise ConfigurationError(f"{_RIG}.{key}: the page states {', '.join(FACT_KEYS)} only")
    facts_of({key: value})


def _demand_tip(text: str) -> None:
    _demand_no_file(set(tip_values(text, registry.load(), "--tip")), text)


def _demand_table(table: str, said: str) -> None:
    if table not in _TABLES:
        allowed = ", ".join(_TABLES)
        raise ConfigurationError(f"{said!r}: the page sets keys of {allowed} only; say table.key=value")


def _demand_no_file(keys: set[str], said: str) -> None:
    if named := sorted(keys & _file_keys()):
        raise ConfigurationError(f"{said!r}: the page names no files ({named[0]}); write it into pipeline.toml")


def _keys_of(value: Any) -> Iterator[str]:
    """Yield the keys of a value of TOML, at whatever depth."""
    if isinstance(value, Mapping):
        yield from value
    inner = value.values() if isinstance(value, Mapping) else value if isinstance(value, list) else ()
    for item in inner:
        yield from _keys_of(item)


def _any(_: str) -> None:
    """Of a name, a reason or a filter: data to the command."""


def _matching(pattern: re.Pattern[str]) -> Callable[[str], None]:
    def demand(value: str) -> None:
        if not pattern.fullmatch(value):
            raise ConfigurationError(f"{value!r}: the page writes to places of its own in the folder only")

    return demand


_FACTS: dict[str, Callable[[str], None]] = {option_of(key): partial(_demand_fact, key) for key in FACT_KEYS}
_SETTINGS = {
    "--set": demand_allowed_setting, "--tip": _demand_tip, "--model": _any, "--no-refit": _any,
}  # fmt: skip
_MARKS = {"--reject", "--accept", "--clear"}
_KNOWN: Mapping[tuple[str, bool], Mapping[str, Callable[[str], None]]] = {  # by command, and whether on the folder
    ("repeat review", True): {**dict.fromkeys(_MARKS, _any), "--reason": _any},
    ("fit", True): {**_SETTINGS, **_FACTS, "--where": _any, "--unset": _demand_key},
    ("fit", False): {
        **_SETTINGS, "--each": _any, "--pipeline": _matching(_PIPELINE),
        "--out": _matching(re.compile(f"{re.escape(OUT)}|{_FIGURES.pattern}")),
    },
    ("fit choose", True): {"--models": _any, "--where": _any, "--json": _any},
    ("repeat", True): {"--by": _any, "--parameter": _any, "--json": _any, "--picture": _matching(_PICTURE)},
    ("report", True): {"--by": _any},
    ("map", True): {"--parameter": _any},
}  # fmt: skip


@lru_cache
def _file_keys() -> frozenset[str]:
    """Return every key of the tables of the page that takes a path, at whatever depth."""
    known = registry.load()
    tables: list[type[Settings]] = [AlignmentSettings]
    tables += [known.find(kind, name) for kind in _PARTS for name in known.parts[kind]]
    return frozenset(name for settings in tables for name in _paths_of(settings))


def _paths_of(settings: type[Settings]) -> Iterator[str]:
    for name, field in settings.model_fields.items():
        for kind in _kinds(field.annotation):
            if isinstance(kind, type) and issubclass(kind, PurePath):
                yield name
            elif isinstance(kind, type) and issubclass(kind, Settings) and kind is not settings:
                yield from _paths_of(kind)


def _kinds(annotation: Any) -> Iterator[Any]:
    """Yield an annotation and all that it is made of."""
    yield annotation
    for inner in get_args(annotation):
        yield from _kinds(inner)
