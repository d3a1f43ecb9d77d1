"""What is wrong with the keys of settings, in words: the same in a pipeline file and in Python."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from palpate.errors import ConfigurationError, suggest

Location = tuple[str, ...]  # ("device", "log", "columns", "z")


@dataclass(frozen=True)
class Mistake:
    """One thing that is wrong, and where."""

    location: Location  # ("model", "dr", "poisson")
    problem: str


def settings_error(error: ValidationError, settings: type[BaseModel]) -> ConfigurationError:
    """What validation says of settings that are made in Python: one line for each mistake."""
    mistakes = mistakes_of(error, settings, ())
    lines = [": ".join((*filter(None, [".".join(m.location)]), m.problem)) for m in mistakes]
    return ConfigurationError(f"{settings.__name__}: {'; '.join(lines)}")


def mistakes_of(error: ValidationError, settings: type[BaseModel], location: Location) -> list[Mistake]:
    """The mistakes in one table that validation found."""
    found = []
    for detail in error.errors(include_url=False):
        *above, last = detail["loc"] or ("",)
        named = detail["type"] in ("extra_forbidden", "missing")  # the last step is a key, whatever it looks like
        inner = tuple(str(step) for step in above if not _is_branch(step))
        inner += (str(last),) if detail["loc"] and (named or not _is_branch(last)) else ()
        key = inner[:-1] if detail["type"] == "extra_forbidden" else inner
        found.append(Mistake(location + key, _problem(detail, settings, inner)))
    misspelt = set(_misspelt(error))
    return [m for m in found if m.location[len(location) :] not in misspelt or not m.problem.startswith(_MISSING)]


def _misspelt(error: ValidationError) -> Iterator[Location]:
    """Keys that are missing since another one, which there is not, was written for them."""
    found = error.errors(include_url=False)
    missing = [tuple(map(str, detail["loc"])) for detail in found if detail["type"] == "missing"]
    for detail in found:
        *above, last = (str(step) for step in detail["loc"] or ("",))
        if detail["type"] == "extra_forbidden":
            beside = [place[-1] for place in missing if place[:-1] == tuple(above)]
            yield from ((*above, name) for name in get_close_matches(last, beside, n=1))


def _is_branch(step: int | str) -> bool:
    """Union branches show up in pydantic's locations; no key of ours looks like one."""
    return isinstance(step, str) and ("[" in step or step in ("float", "constrained-str", "Signal"))


_MISSING = "is missing"
_WORDS = {
    "int": "a whole number",
    "float": "a number",
    "bool": "true or false",
    "string": "a text",
    "dict": "a table",
    "model": "a table",
    "tuple": "a list",
    "path": "a path",
}


def _problem(detail: ErrorDetails, settings: type[BaseModel], inner: Location) -> str:
    given, kind = detail["input"], detail["type"]
    if kind == "missing":
        return f"{_MISSING} ({_meaning(settings, inner)})"
    if kind == "extra_forbidden":
        return f"unknown key {inner[-1]!r}{suggest(inner[-1], _fields(settings, inner[:-1]))}"
    if kind == "literal_error":
        expected = str(detail.get("ctx", {}).get("expected", "")).replace(" or ", ",").split(",")
        allowed = [word.strip().strip("'") for word in expected]
        return f"{_shown(given)} is not allowed{suggest(str(given), allowed)}"
    if kind in ("quantity", "tare", "value_error"):
        return detail["msg"].removeprefix("Value error, ")
    word = _WORDS.get(kind.split("_")[0])
    if word is not None and kind.endswith(("_type", "_from_float", "_parsing")):
        return f"must be {word}, not {_shown(given)}"
    return f"{_shown(given)}: {detail['msg'].replace('Input should', 'must')}"


def _shown(given: Any) -> str:
    """What was given, as TOML writes it."""
    text = str(given).lower() if isinstance(given, bool) else repr(given)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _nested(settings: type[BaseModel], path: Location) -> type[BaseModel] | None:
    """The settings at the end of a path of keys; the keys of a dictionary of settings count as steps."""
    current: Any = settings
    for step in path:
        if isinstance(current, type) and issubclass(current, BaseModel):
            field = current.model_fields.get(step)
            current = field.annotation if field else None
        else:
            current = next((a for a in get_args(current) if isinstance(a, type) and issubclass(a, BaseModel)), None)
    if not isinstance(current, type):
        current = next((a for a in get_args(current) if isinstance(a, type) and issubclass(a, BaseModel)), None)
    return current if isinstance(current, type) and issubclass(current, BaseModel) else None


def _fields(settings: type[BaseModel], path: Location) -> list[str]:
    nested = _nested(settings, path)
    return list(nested.model_fields) if nested else []


def _meaning(settings: type[BaseModel], inner: Location) -> str:
    nested = _nested(settings, inner[:-1])
    field = nested.model_fields.get(inner[-1]) if nested else None
    return (field.description if field and field.description else "") or "it must be given"
