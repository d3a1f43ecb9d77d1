"""``palpate describe``: a part with every key, or the meaning of a flag."""

from __future__ import annotations

import inspect
import json
import types
import typing
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer
from palpate import ConfigurationError, Settings, suggest
from palpate_engine import (
    FORMER_FLAGS,
    SEVERITIES,
    AlignmentSettings,
    FlagEntry,
    Quantity,
    Registry,
    RunSettings,
    dimension,
    nested_settings,
    part_kind,
    registry as registries,
)
from palpate_kit.terminal.json_output import print_json
from palpate_kit.terminal.options import JsonOption

from palpate_commands.list_parts import list_parts

_TABLES: dict[str, type[Settings]] = {"run": RunSettings, "alignment": AlignmentSettings}


def describe(
    part: Annotated[
        str | None,
        typer.Argument(
            metavar="[NAME]",
            help="Name of a part, as in `palpate list`; or run, alignment; or a flag's code. [default: list all]",
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Describe a part: what it is, and every key with unit, default and meaning; or a flag: what it means."""
    if part is None:
        list_parts(as_json=as_json)
        return
    registry = registries.load()
    parts = _parts_named(registry, part)
    flag = registry.flags.get(part)
    if as_json and (parts or flag is not None):
        tables = [_part_table(named.table_kind, named.settings) for named in parts]
        print_json({"name": part, "parts": tables, "flags": [] if flag is None else [flag.meaning]})
        return
    # The name of a part may be that of a flag as well, present or former.
    texts = ["\n".join(_description(named.title, named.settings)) for named in parts]
    if part in FORMER_FLAGS:
        texts.append(f"{part}: since schema 5 a condition of {FORMER_FLAGS[part]}: what the values hold for, no doubt")
    if flag is not None:
        texts.append("\n".join(_flag_description(part, flag)))
    if not texts:
        names = [*_TABLES, *(name for entries in registry.parts.values() for name in entries), *registry.flags]
        notices = "".join(f"; {notice}" for notice in registry.notices)
        raise ConfigurationError(f"no part or flag {part!r}{suggest(part, names)}{notices}")
    typer.echo("\n\n".join(texts))


class _NamedPart(NamedTuple):
    """Settings that a name stands for: those of a part of a kind, or of a table of every pipeline."""

    table_kind: str
    title: str
    settings: type[Settings]


def _parts_named(registry: Registry, name: str) -> list[_NamedPart]:
    """Return the parts of all kinds with a name, or initials, and the table of that name."""
    parts = []
    for kind in registry.parts:
        with suppress(ConfigurationError):  # no part of that kind has the name
            full_name = registry.named(kind, name)
            parts.append(_NamedPart(kind, f"{full_name}: a type of [{kind}.*]", registry.find(kind, full_name)))
    if name in _TABLES:
        parts.append(_NamedPart("table", f"[{name}]: a table of every pipeline", _TABLES[name]))
    return parts


def _flag_description(code: str, entry: FlagEntry) -> Iterator[str]:
    """Yield the lines of a flag: severity, meaning, remedy and plugin."""
    yield f"{code}: a flag, {entry.meaning.severity} ({SEVERITIES[entry.meaning.severity]})"
    yield ""
    yield entry.meaning.meaning
    yield f"What to do: {entry.meaning.remedy}"
    yield f"Registered by {entry.plugin.name}."


def _description(title: str, part: type[Settings]) -> Iterator[str]:
    """Yield the lines of a part: its text, the parameters of a model, its keys and those of tables within."""
    yield title
    yield ""
    yield inspect.getdoc(part) or ""
    parameters = getattr(part, "parameters", ())
    if parameters:
        yield ""
        yield "Parameters:"
        yield from (f"  {p.name} ({p.symbol}) [{p.unit}]: {p.meaning}" for p in parameters)
    if part.model_fields:
        yield ""
        yield "Keys:"
        yield from _keys(part, "  ")
    tables = [nested_settings(field.annotation) for field in part.model_fields.values()]
    by_name = {settings.__name__: settings for settings in tables if settings is not None}
    for name, settings in by_name.items():
        yield ""
        yield f"{name.lower()}: {inspect.getdoc(settings) or ''}"
        yield ""
        yield f"Keys of the table {name.lower()}:"
        yield from _keys(settings, "  ")


def _part_table(kind: str, part: type[Settings]) -> dict[str, Any]:
    """Return a part as plain data: its text, the parameters of a model, its keys and those of tables within."""
    parameters = [
        {"name": p.name, "symbol": p.symbol, "unit": p.unit, "meaning": p.meaning}
        for p in getattr(part, "parameters", ())
    ]
    keys = {}
    for key, field in part.model_fields.items():
        unit = next((item.unit for item in field.metadata if isinstance(item, Quantity)), None)
        required, default = field.is_required(), None
        if not required:
            default = json.loads(json.dumps(field.get_default(call_default_factory=True), default=str))
        nested = nested_settings(field.annotation)
        keys[key] = {"type": type_text(field.annotation, field.metadata), "unit": unit, "required": required}
        keys[key] |= {"default": default, "meaning": field.description}
        keys[key] |= {"keys": _part_table("table", nested)["keys"]} if nested is not None else {}
    return {"kind": kind, "text": inspect.getdoc(part) or "", "parameters": parameters, "keys": keys}


def _keys(settings: type[Settings], indent: str) -> Iterator[str]:
    """Yield the lines of the keys: type, default and meaning."""
    for key, field in settings.model_fields.items():
        default = "must be given" if field.is_required() else default_text(field.get_default(), field.metadata)
        yield f"{indent}{key}: {type_text(field.annotation, field.metadata)}, {default}"
        if field.description:
            yield f"{indent}    {field.description}"


def default_text(value: Any, metadata: list[Any]) -> str:
    """Return a default in words, a number with its unit."""
    if value is None:
        return "optional"
    unit = next((f" {item.unit}" for item in metadata if isinstance(item, Quantity)), "")
    return f"default {value:.6g}{unit}" if isinstance(value, float) else f"default {json.dumps(value, default=str)}"


_TYPE_WORDS = {float: "number", int: "whole number", str: "text", bool: "true or false", Path: "path"}


def type_text(annotation: Any, metadata: list[Any]) -> str:
    """Return the type of a field, in words."""
    quantity = next((item for item in metadata if isinstance(item, Quantity)), None)
    if quantity is not None:
        return dimension(quantity.unit)
    kind, nested = part_kind(annotation), nested_settings(annotation)
    if kind is not None:
        return f"name of a [{kind}.*] or a table"
    if nested is not None:
        return f"table {nested.__name__.lower()}"
    if getattr(annotation, "__metadata__", None):
        return type_text(annotation.__origin__, list(annotation.__metadata__))
    return _of_several(annotation) or _TYPE_WORDS.get(annotation, "value")


def _of_several(annotation: Any) -> str:
    """Return an annotation that is made of other types, such as a union or a tuple, in words; empty for any other."""
    origin = typing.get_origin(annotation)
    arguments = tuple(argument for argument in typing.get_args(annotation) if argument is not type(None))
    if origin is dict:
        return f"table of names, each a {type_text(arguments[1], [])}"
    if origin is typing.Literal:
        return " or ".join(json.dumps(choice) for choice in arguments)
    for argument in arguments:  # optional quantities carry their unit inside the union
        if getattr(argument, "__metadata__", None):
            return type_text(argument.__origin__, list(argument.__metadata__))
    if origin is tuple:
        return "list"
    if len(arguments) == 1:
        return type_text(arguments[0], [])
    if origin in (typing.Union, types.UnionType):
        return " or ".join(type_text(argument, []) for argument in arguments)
    return ""
