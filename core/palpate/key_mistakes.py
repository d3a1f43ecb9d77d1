"""Mistakes in the keys of settings, in words: the same in a pipeline file and in Python."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from palpate.errors import ConfigurationError, suggest

_MAX_SHOWN = 60  # characters, a choice: of a value in a message

Location = tuple[str, ...]  # ("device", "log", "columns", "z")


@dataclass(frozen=True)
class Mistake:
    """One mistake, and its place."""

    location: Location  # ("model", "dr", "poisson")
    problem: str


def settings_error(error: ValidationError, settings: type[BaseModel]) -> ConfigurationError:
    """Return the error of settings that are made in Python: one clause for each mistake."""
    mistakes = mistakes_of(error, settings, ())
    lines = [": ".join((*filter(None, [".".join(m.location)]), m.problem)) for m in mistakes]
    return ConfigurationError(f"{settings.__name__}: {'; '.join(lines)}")


def mistakes_of(error: ValidationError, settings: type[BaseModel], location: Location) -> list[Mistake]:
    """Return the mistakes in one table that validation found."""
    mistakes = []
    for detail in error.errors(include_url=False):
        keys = _key_path(detail)
        # An unknown key is a mistake of the table that has it.
        place = keys[:-1] if detail["type"] == "extra_forbidden" else keys
        mistakes.append(Mistake(location + place, _problem(detail, settings, keys)))
    # A key is not reported as missing where a similar unknown one is.
    misspelt = set(_misspelt_keys(error))
    return [m for m in mistakes if m.location[len(location) :] not in misspelt or not m.problem.startswith(_MISSING)]


def _key_path(detail: ErrorDetails) -> Location:
    """Return the keys of an error's location, without the branches of unions."""
    *parents, last = detail["loc"] or ("",)
    keys = tuple(str(step) for step in parents if not _is_branch(step))
    is_key = detail["type"] in ("extra_forbidden", "missing")  # the last step is a key, even if it looks like a branch
    if detail["loc"] and (is_key or not _is_branch(last)):
        keys += (str(last),)
    return keys


def _misspelt_keys(error: ValidationError) -> Iterator[Location]:
    """Yield the missing keys for which a similar unknown key was written."""
    details = error.errors(include_url=False)
    missing = [tuple(map(str, detail["loc"])) for detail in details if detail["type"] == "missing"]
    for detail in details:
        *parents, last = (str(step) for step in detail["loc"] or ("",))
        if detail["type"] == "extra_forbidden":
            siblings = [place[-1] for place in missing if place[:-1] == tuple(parents)]
            yield from ((*parents, name) for name in get_close_matches(last, siblings, n=1))


def _is_branch(step: int | str) -> bool:
    """Return True for a branch of a union, a step of pydantic's locations that no key of settings looks like."""
    return isinstance(step, str) and ("[" in step or step in ("float", "constrained-str", "Signal"))


_MISSING = "is missing"
_TYPE_NAMES = {
    "int": "a whole number",
    "float": "a number",
    "bool": "true or false",
    "string": "a text",
    "dict": "a table",
    "model": "a table",
    "tuple": "a list",
    "path": "a path",
}


def _problem(detail: ErrorDetails, settings: type[BaseModel], keys: Location) -> str:
    """Return the mistake of one error in words."""
    value, error_type = detail["input"], detail["type"]
    if error_type == "missing":
        return f"{_MISSING} ({_meaning(settings, keys)})"
    if error_type == "extra_forbidden":
        return f"unknown key {keys[-1]!r}{suggest(keys[-1], _fields(settings, keys[:-1]))}"
    if error_type == "literal_error":
        expected = str(detail.get("ctx", {}).get("expected", "")).replace(" or ", ",").split(",")
        allowed = [choice.strip().strip("'") for choice in expected]
        return f"{_as_toml(value)} is not allowed{suggest(str(value), allowed)}"
    if error_type in ("quantity", "tare", "value_error"):
        return detail["msg"].removeprefix("Value error, ")
    type_name = _TYPE_NAMES.get(error_type.split("_")[0])
    if type_name is not None and error_type.endswith(("_type", "_from_float", "_parsing")):
        return f"must be {type_name}, not {_as_toml(value)}"
    return f"{_as_toml(value)}: {detail['msg'].replace('Input should', 'must')}"


def _as_toml(value: Any) -> str:
    """Return a value as TOML writes it, cut to `_MAX_SHOWN`."""
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    return text if len(text) <= _MAX_SHOWN else f"{text[: _MAX_SHOWN - 3]}..."


def _nested(settings: type[BaseModel], path: Location) -> type[BaseModel] | None:
    """Return the settings at the end of a path of keys; the keys of a dictionary of settings count as steps."""
    current: Any = settings
    for step in path:
        if isinstance(current, type) and issubclass(current, BaseModel):
            field = current.model_fields.get(step)
            current = field.annotation if field else None
        else:
            current = _settings_in(current)
    if not isinstance(current, type):
        current = _settings_in(current)
    return current if isinstance(current, type) and issubclass(current, BaseModel) else None


def _settings_in(annotation: Any) -> type[BaseModel] | None:
    """Return the first settings among the arguments of an annotation; None without any."""
    for argument in get_args(annotation):
        if isinstance(argument, type) and issubclass(argument, BaseModel):
            return argument
    return None


def _fields(settings: type[BaseModel], path: Location) -> list[str]:
    nested = _nested(settings, path)
    return list(nested.model_fields) if nested else []


def _meaning(settings: type[BaseModel], keys: Location) -> str:
    """Return the description of a key."""
    nested = _nested(settings, keys[:-1])
    field = nested.model_fields.get(keys[-1]) if nested else None
    return (field.description if field and field.description else "") or "it must be given"
