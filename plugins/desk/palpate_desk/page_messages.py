"""What the page can ask for: a closed list, checked before anything is done."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from palpate import ConfigurationError, Settings
from palpate_engine import AlignmentSettings, registry
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

LARGEST = 64 * 1024  # bytes of a message
_PARTS = ("estimator", "indenter", "model")
_TABLES = ("alignment", *_PARTS)  # that name no code

Name = Annotated[str, Field(min_length=1, max_length=1000)]
Text = Annotated[str, Field(max_length=1000)]


class Question(BaseModel):
    """A message of the page."""

    model_config = ConfigDict(extra="forbid", strict=True)


class CurveQuestion(Question):
    """A curve to look at."""

    do: Literal["curve"]
    curve: Name
    number: int = 0


class FilterQuestion(Question):
    """Filter words: which rows hold."""

    do: Literal["filter"]
    words: Text


class MarkOrder(Question):
    """A mark on a curve."""

    do: Literal["mark"]
    curve: Name
    mark: Literal["good", "bad", "none"]
    reason: Text = ""


class SetOrder(Question):
    """A setting of one curve, of those of filter words, or of all."""

    do: Literal["set"]
    assignment: Text
    where: Text | None = None


class TipOrder(Question):
    """Another tip, or another model, for all curves."""

    do: Literal["tip", "model"]
    value: Name


class RefitOrder(Question):
    """One curve fitted anew, or all that are not current; or an end to that."""

    do: Literal["refit", "refit-all", "cancel", "undo"]
    curve: Text = ""


class GroupsQuestion(Question):
    """Statistics and tests between groups."""

    do: Literal["groups"]
    by: Name
    parameter: Name


class CompareQuestion(Question):
    """Models weighed on a curve."""

    do: Literal["compare"]
    curve: Name
    model: Name


class ExportOrder(Question):
    """Something to write into the folder."""

    do: Literal["export"]
    what: Literal["report", "groups", "map", "figure", "history"]
    by: Text = ""
    parameter: Text = ""
    curve: Text = ""


Message = Annotated[
    CurveQuestion | FilterQuestion | MarkOrder | SetOrder | TipOrder | RefitOrder | GroupsQuestion | CompareQuestion
    | ExportOrder,
    Field(discriminator="do"),
]  # fmt: skip
_MESSAGES: TypeAdapter[
    CurveQuestion | FilterQuestion | MarkOrder | SetOrder | TipOrder | RefitOrder | GroupsQuestion | CompareQuestion
    | ExportOrder
] = TypeAdapter(Message)  # fmt: skip
READING = (CurveQuestion, FilterQuestion, GroupsQuestion, CompareQuestion)  # which write nothing


def read_message(text: str | bytes) -> Question:
    """A message of the page; raises ConfigurationError for what is none."""
    try:
        return _MESSAGES.validate_json(text)
    except ValidationError as error:
        first = error.errors()[0]
        raise ConfigurationError(f"the page: {'.'.join(map(str, first['loc']))}: {first['msg']}") from error


def demand_allowed(assignment: str) -> None:
    """Raise ConfigurationError for a setting that the page may not change: of a file, a plugin, a device."""
    key, equals, _ = assignment.partition("=")
    table = key.strip().split(".")[0]
    if not equals or table not in _TABLES:
        allowed = ", ".join(_TABLES)
        raise ConfigurationError(f"{assignment!r}: the page sets keys of {allowed} only; say table.key=value")
    demand_no_file(assignment)


def demand_no_file(text: str) -> None:
    """Raise ConfigurationError for a setting or a tip that names a file, in its key or within its value."""
    if named := sorted(set(re.findall(r"\w+", text)) & _file_keys()):
        raise ConfigurationError(f"{text!r}: the page names no files ({named[0]}); write it into pipeline.toml")


@lru_cache
def _file_keys() -> frozenset[str]:
    """Every key of the tables of the page that takes a path, at whatever depth."""
    known = registry.load()
    tables: list[type[Settings]] = [AlignmentSettings]
    tables += [known.find(kind, name) for kind in _PARTS for name in known.parts[kind]]
    return frozenset(name for settings in tables for name in _paths_of(settings))


def _paths_of(settings: type[Settings]) -> Iterator[str]:
    for name, field in settings.model_fields.items():
        for kind in _kinds(field.annotation):
            if kind is Path:
                yield name
            elif isinstance(kind, type) and issubclass(kind, Settings) and kind is not settings:
                yield from _paths_of(kind)


def _kinds(annotation: Any) -> Iterator[Any]:
    """An annotation and all that it is made of."""
    yield annotation
    for inner in get_args(annotation):
        yield from _kinds(inner)
