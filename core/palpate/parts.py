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
    """Return lists, which TOML has, as tuples, since settings are frozen; other values stay."""
    return tuple(_tuples(item) for item in value) if isinstance(value, list) else value


def _forget_derived(settings: BaseModel) -> None:
    """Drop the numbers that settings have computed from their fields, which are void in a copy with other fields."""
    attributes = vars(settings)
    for name in attributes.keys() - type(settings).model_fields.keys():
        del attributes[name]


class Settings(BaseModel):
    """A table of a pipeline file: frozen, strict, and closed to keys that it does not know.

    Numbers that follow from the fields may be kept in a `cached_property`, never in a private attribute: a copy with
    other values (`model_copy`) computes them again.
    """

    model_config = ConfigDict(frozen=True, strict=True, extra="forbid", protected_namespaces=())

    def __init__(self, /, **keys: Any) -> None:
        """Make settings by their keys; raises ConfigurationError with every mistake at once."""
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
    """Return the direct alternatives of an annotation: itself, or the members of a union; not those in a container."""
    if get_origin(annotation) in (Union, UnionType):
        return get_args(annotation)
    return (annotation,)


def part_kind(annotation: Any) -> str | None:
    """Return the kind of part that a field's annotation requires; None if it requires none."""
    for candidate in _alternatives(annotation):
        if isinstance(candidate, type) and issubclass(candidate, Part):
            return candidate.kind
    return None


def nested_settings(annotation: Any) -> type[Settings] | None:
    """Return the settings (not parts) that a field's annotation requires; None if it requires none."""
    for candidate in _alternatives(annotation):
        if isinstance(candidate, type) and issubclass(candidate, Settings) and not issubclass(candidate, Part):
            return candidate
    return None


def table_of_parts(annotation: Any) -> Any:
    """Return the part that each entry of a field's table must be; None where the field holds no table of parts."""
    if get_origin(annotation) is dict:
        inner = get_args(annotation)[1]
        return inner if part_kind(inner) else None
    return None


class TextOfFile(str):
    """A text that another file than the pipeline states; a path in it, where relative, is relative to that file."""

    folder: Path

    def __new__(cls, text: str, folder: Path) -> Self:
        """Return the text, marked with the folder of its file."""
        marked = super().__new__(cls, text)
        marked.folder = folder
        return marked

    def __reduce__(self) -> tuple[type[TextOfFile], tuple[str, Path]]:
        return TextOfFile, (str(self), self.folder)


def _relative_to_pipeline(value: Any, info: ValidationInfo) -> Any:
    """Return a path in the folder of the pipeline file, which the context names."""
    if not isinstance(value, str | Path):
        return value
    base = value.folder if isinstance(value, TextOfFile) else (info.context or {}).get("base", Path())
    return Path(base) / os.path.expanduser(value)  # which, other than that of pathlib, never raises


File = Annotated[Path, BeforeValidator(_relative_to_pipeline)]
"""A path; where it is relative, relative to the pipeline file that names it."""


def _check_path(path: Path, info: ValidationInfo) -> Path:
    check_input(path, (info.context or {}).get("enclosure"))
    return path


InputFile = Annotated[Path, BeforeValidator(_relative_to_pipeline), AfterValidator(_check_path)]
"""A `File` with data: regular, of at most 32 MiB, and in a log's pipeline within the log's folder."""


def input_files(value: Any) -> list[Path]:
    """Return every input file that settings, also nested ones, name."""
    files: list[Path] = []
    if isinstance(value, dict | tuple):
        for item in value.values() if isinstance(value, dict) else value:
            files += input_files(item)
        return files
    for name, field in type(value).model_fields.items() if isinstance(value, Settings) else ():
        item = getattr(value, name)
        annotation = Annotated[field.annotation, *field.metadata] if field.metadata else field.annotation
        if isinstance(item, Path) and InputFile in _alternatives(annotation):
            files.append(item)
        else:
            files += input_files(item)
    return files


def _metadata(annotation: Any) -> list[Any]:
    """Return the metadata of an annotation and of its alternatives, at any depth of unions."""
    metadata = list(getattr(annotation, "__metadata__", ()))
    for argument in get_args(annotation):
        if not isinstance(argument, str):
            metadata += _metadata(argument)
    return metadata


def numbers_of(part: Settings, above: tuple[str, ...] = ()) -> list[tuple[tuple[str, ...], float, str]]:
    """Return every number among the keys of settings, also nested ones: path, value, SI unit."""
    numbers: list[tuple[tuple[str, ...], float, str]] = []
    for name, field in type(part).model_fields.items():
        value = getattr(part, name)
        if isinstance(value, Settings):
            numbers += numbers_of(value, (*above, name))
        elif isinstance(value, float):
            # The unit is that of the first quantity among the field's metadata.
            metadata = (*field.metadata, *_metadata(field.annotation))
            units = [item.unit for item in metadata if isinstance(getattr(item, "unit", None), str)]
            numbers.append(((*above, name), value, units[0] if units else "1"))
    return numbers
