"""The gate that every command of the page passes: permitted commands, options, settings and marks."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
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
_TABLES = ("alignment", *_PARTS)  # permitted tables: none of their keys names code
_RIG = "rig"  # table of the facts
FACT_KEYS = tuple(facts_stated().values())  # facts on the page
_BARE_KEY = re.compile(r"[\w-]+")
_PICTURE = re.compile(rf"{re.escape(OUT)}/groups\.svg")
_PIPELINE = re.compile(rf"{re.escape(OUT)}/pipeline[^/]*\.toml")
_FOLDER = re.compile(rf"{re.escape(OUT)}|{re.escape(OUT)}/figures/[^/]+")


def demand_allowed(action: Action) -> None:
    """Raise ConfigurationError for an action that the page does not have, or that names a file, code or a device."""
    permitted = _PERMITTED.get((action.command, action.source == OUT), {})
    for option, value in action.options:
        if option not in permitted:
            raise ConfigurationError(f"palpate {action.command} {option}: is not a command of the page")
        demand_permitted_value = permitted[option]
        demand_permitted_value(value)
    marks = _MARKS & {option for option, _ in action.options}
    if not permitted or (action.command == "repeat review" and len(marks) != 1):
        raise ConfigurationError(f"palpate {action.command}: is not a command of the page")


def is_change(action: Action) -> bool:
    """Return True if a command changes marks, settings or fits of a folder, or makes one: one of its history."""
    options = dict(action.options)
    makes_folder = "--tip" in options and "--pipeline" not in options and options.get("--out") == OUT
    return action.command in ("fit", "repeat review") and (action.source == OUT or makes_folder)


def demand_allowed_setting(assignment: str) -> None:
    """Raise ConfigurationError for a setting that the page may not change: of a file, a plugin, a device."""
    keys, value = parsed_assignment(assignment)
    if keys[0] == _RIG:
        _demand_fact(".".join(keys[1:]), value)
        return
    _demand_table(keys[0], assignment)
    if not all(map(_BARE_KEY.fullmatch, keys)):
        raise ConfigurationError(f"{assignment!r}: its key has signs that no name of a setting has")
    _demand_no_file({*keys, *_keys_of(value)}, assignment)


def _demand_key(key: str) -> None:
    """Raise ConfigurationError for the key of a setting, as in ``--unset``, that the page may not change."""
    table, _, name = key.partition(".")
    if table != _RIG or name not in FACT_KEYS:
        _demand_table(table.strip(), key)


def _demand_fact(key: str, value: Any) -> None:
    """Raise ConfigurationError for anything but a fact that the page asks for: none of these names a file."""
    if key not in FACT_KEYS:
        raise ConfigurationError(f"{_RIG}.{key}: the page states {', '.join(FACT_KEYS)} only")
    facts_of({key: value})


def _demand_tip(text: str) -> None:
    """Raise ConfigurationError for words of a tip that name a file."""
    _demand_no_file(set(tip_values(text, registry.load(), "--tip")), text)


def _demand_table(table: str, setting: str) -> None:
    """Raise ConfigurationError for a setting of a table that the page may not change."""
    if table not in _TABLES:
        allowed = ", ".join(_TABLES)
        raise ConfigurationError(f"{setting!r}: the page sets keys of {allowed} only; say table.key=value")


def _demand_no_file(keys: set[str], setting: str) -> None:
    """Raise ConfigurationError for a setting if one of its keys takes a path."""
    file_keys = sorted(keys & _file_keys())
    if file_keys:
        raise ConfigurationError(f"{setting!r}: the page names no files ({file_keys[0]}); write it into pipeline.toml")


def _keys_of(value: Any) -> Iterator[str]:
    """Yield the keys of all tables in a value of TOML, at any depth."""
    entries: Iterable[Any] = ()
    if isinstance(value, Mapping):
        yield from value
        entries = value.values()
    elif isinstance(value, list):
        entries = value
    for entry in entries:
        yield from _keys_of(entry)


def _permit_any(_: str) -> None:
    """Permit a name, a reason or filter words: to the command they are data."""


def _path_check(pattern: re.Pattern[str]) -> Callable[[str], None]:
    """Return a function that raises ConfigurationError for a path that does not match a pattern."""

    def demand_matching_path(path: str) -> None:
        if not pattern.fullmatch(path):
            raise ConfigurationError(f"{path!r}: the page writes to places of its own in the folder only")

    return demand_matching_path


_FACTS: dict[str, Callable[[str], None]] = {option_of(key): partial(_demand_fact, key) for key in FACT_KEYS}
_SETTINGS = {
    "--set": demand_allowed_setting, "--tip": _demand_tip, "--model": _permit_any, "--no-refit": _permit_any,
}  # fmt: skip
_MARKS = {"--reject", "--accept", "--clear"}
# Checks of the values of the permitted options, by command, and True for one on the folder.
_PERMITTED: Mapping[tuple[str, bool], Mapping[str, Callable[[str], None]]] = {
    ("repeat review", True): {**dict.fromkeys(_MARKS, _permit_any), "--reason": _permit_any},
    ("fit", True): {**_SETTINGS, **_FACTS, "--where": _permit_any, "--unset": _demand_key},
    ("fit", False): {
        **_SETTINGS, "--each": _permit_any, "--pipeline": _path_check(_PIPELINE),
        "--out": _path_check(_FOLDER),
    },
    ("fit choose", True): {"--models": _permit_any, "--where": _permit_any, "--json": _permit_any},
    ("repeat", True): {
        "--by": _permit_any, "--parameter": _permit_any, "--json": _permit_any, "--picture": _path_check(_PICTURE),
    },
    ("report", True): {"--by": _permit_any},
    ("map", True): {"--parameter": _permit_any},
}  # fmt: skip


@lru_cache
def _file_keys() -> frozenset[str]:
    """Return every key of the permitted tables that takes a path, at any depth."""
    parts_registry = registry.load()
    tables: list[type[Settings]] = [AlignmentSettings]
    tables += [parts_registry.find(part, name) for part in _PARTS for name in parts_registry.parts[part]]
    return frozenset(name for settings in tables for name in _path_fields(settings))


def _path_fields(settings: type[Settings]) -> Iterator[str]:
    """Yield the fields of settings that take a path, and those of settings within them."""
    for name, field in settings.model_fields.items():
        for annotation in _inner_annotations(field.annotation):
            if not isinstance(annotation, type):
                continue
            if issubclass(annotation, PurePath):
                yield name
            elif issubclass(annotation, Settings) and annotation is not settings:
                yield from _path_fields(annotation)


def _inner_annotations(annotation: Any) -> Iterator[Any]:
    """Yield an annotation and its arguments at any depth."""
    yield annotation
    for argument in get_args(annotation):
        yield from _inner_annotations(argument)
