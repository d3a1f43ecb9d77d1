"""Parts: anything that a TOML table can name by ``type = "..."``; frozen settings, no state.

A part's fields are the keys of its table, its documentation and its JSON schema at once.
"""

from __future__ import annotations

import os
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, ClassVar, Self, Union, get_args, get_origin

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    ValidationError,
    ValidationInfo,
    model_validator,
)

from palpate.input_file import check_input
from palpate.key_mistakes import settings_error


def _tuples(value: Any) -> Any:
    """TOML has only lists; settings are frozen, so they hold tuples."""
    return tuple(_tuples(item) for item in value) if isinstance(value, list) else value


def _forget_derived(settings: BaseModel) -> None:
    """What settings have computed from their fields is void in a copy with other fields."""
    kept = vars(settings)
    for name in kept.keys() - type(settings).model_fields.keys():
        del kept[name]


class Settings(BaseModel):
    """A table of a pipeline file: frozen, strict, and closed to keys that it does not know.

    What follows from the fields may be kept in a `cached_property`, never in a private attribute: a copy with other
    values (`model_copy`) computes it again.
    """

    model_config = ConfigDict(frozen=True, strict=True, extra="forbid", protected_namespaces=())

    def __init__(self, /, **keys: Any) -> None:
        """Settings by their keys; raises ConfigurationError with every mistake at once."""
        try:
            super().__init__(**keys)
        except ValidationError as error:
            raise settings_error(error, type(self)) from None

    # Validation of a table does not pass here: it has a context, and a way to report where a mistake is.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    @model_validator(mode="before")
    @classmethod
    def _freeze_lists(cls, data: Any) -> Any:
        return {key: _tuples(value) for key, value in data.items()} if isinstance(data, dict) else data

    def __copy__(self) -> Self:
        copied = super().__copy__()
        _forget_derived(copied)
        return copied

    def __deepcopy__(self, memo: dict[int, Any] | None = None) -> Self:
        copied = super().__deepcopy__(memo)
        _forget_derived(copied)
        return copied


class Part(Settings):
    """Settings that a table names by ``type = "..."``; a class that sets `kind` in its body opens a new kind."""

    kind: ClassVar[str]


def _alternatives(annotation: Any) -> tuple[Any, ...]:
    """What an annotation allows directly: itself, or the members of a union; not what a container holds."""
    if get_origin(annotation) in (Union, UnionType):
        return get_args(annotation)
    return (annotation,)


def part_kind(annotation: Any) -> str | None:
    """The kind of part that a field's annotation asks for, or None where it asks for none."""
    for candidate in _alternatives(annotation):
        if isinstance(candidate, type) and issubclass(candidate, Part):
            return candidate.kind
    return None


def nested_settings(annotation: Any) -> type[Settings] | None:
    """The settings (not parts) that a field's annotation asks for, or None where it asks for none."""
    for candidate in _alternatives(annotation):
        if isinstance(candidate, type) and issubclass(candidate, Settings) and not issubclass(candidate, Part):
            return candidate
    return None


def table_of_parts(annotation: Any) -> Any:
    """The part that each entry of a field's table must be, or None where the field holds no table of parts."""
    if get_origin(annotation) is dict:
        inner = get_args(annotation)[1]
        return inner if part_kind(inner) else None
    return None


def _beside_the_pipeline(value: Any, info: ValidationInfo) -> Any:
    if not isinstance(value, str | Path):
        return value
    base = (info.context or {}).get("base", Path())
    return Path(base) / os.path.expanduser(value)  # which, other than that of pathlib, never raises


File = Annotated[Path, BeforeValidator(_beside_the_pipeline)]
"""A path; where it is relative, relative to the pipeline file that names it."""


def _checked(path: Path, info: ValidationInfo) -> Path:
    check_input(path, (info.context or {}).get("enclosure"))
    return path


InputFile = Annotated[Path, BeforeValidator(_beside_the_pipeline), AfterValidator(_checked)]
"""A `File` that data are read from: regular, of at most 32 MiB, and in a log's pipeline within the log's folder."""


def input_files(value: Any) -> list[Path]:
    """Every input file that settings, and what is nested in them, name."""
    if isinstance(value, dict | tuple):
        return [file for item in (value.values() if isinstance(value, dict) else value) for file in input_files(item)]
    found: list[Path] = []
    for name, described in type(value).model_fields.items() if isinstance(value, Settings) else ():
        item = getattr(value, name)
        one = Annotated[described.annotation, *described.metadata] if described.metadata else described.annotation
        if isinstance(item, Path) and InputFile in _alternatives(one):
            found.append(item)
        else:
            found += input_files(item)
    return found


def _marks(annotation: Any) -> list[Any]:
    """The metadata of what an annotation allows, at any depth of unions."""
    inner = [mark for one in get_args(annotation) if not isinstance(one, str) for mark in _marks(one)]
    return [*getattr(annotation, "__metadata__", ()), *inner]


def numbers_of(part: Settings, above: tuple[str, ...] = ()) -> list[tuple[tuple[str, ...], float, str]]:
    """Every number among the keys of settings and of what is nested in them: path, value, SI unit."""
    found: list[tuple[tuple[str, ...], float, str]] = []
    for name, described in type(part).model_fields.items():
        value = getattr(part, name)
        if isinstance(value, Settings):
            found += numbers_of(value, (*above, name))
        elif isinstance(value, float):
            marks = (*described.metadata, *_marks(described.annotation))
            units = (getattr(item, "unit", None) for item in marks)
            found.append(((*above, name), value, next((unit for unit in units if isinstance(unit, str)), "1")))
    return found
