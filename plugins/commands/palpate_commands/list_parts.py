"""``palpate list``: every part that a pipeline can name."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import asdict
from typing import Annotated, Any

import typer
from palpate import API, ConfigurationError, Part, suggest
from palpate_engine import Entry, Registry, deprecated_uses, registry as registries, unpromised_uses
from palpate_kit.terminal.json_output import print_json
from palpate_kit.terminal.options import JsonOption


def list_parts(
    word: Annotated[
        str | None, typer.Argument(metavar="[WORD]", help="Only parts with this word in kind, name, text or plugin.")
    ] = None,
    plugins: Annotated[
        bool,
        typer.Option(
            "--plugins", help="List plugins: the interface that each states, and its names that go or are not promised."
        ),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """List every part that a pipeline can name, by kind, with the plugin it comes from; with a word those that have it.

    `palpate describe NAME` shows the keys of one.
    """
    registry = registries.load()
    if plugins:
        list_plugins(registry, as_json)
        return
    parts = {kind: _matching_parts(kind, entries, word) for kind, entries in registry.parts.items()}
    if word is not None:
        parts = {kind: entries for kind, entries in parts.items() if entries}
        if not parts:
            names = [*registry.parts, *(name for entries in registry.parts.values() for name in sorted(entries))]
            raise ConfigurationError(f"no part has the word {word!r}{suggest(word, names)}")
    if as_json:
        print_json({kind: _summaries(entries) for kind, entries in parts.items()})
    else:
        _print_parts(parts)
    # Notices, and the problems of parts that are left out, come last on the error stream.
    for notice in registry.notices:
        typer.echo(notice, err=True)
    for entries in registry.parts.values():
        for _, entry in sorted(entries.items()):
            if entry.problem is not None:
                typer.echo(entry.problem, err=True)


def _matching_parts(kind: str, entries: Mapping[str, Entry], word: str | None) -> dict[str, Entry]:
    """Return the usable parts of a kind by name, in order; with a word those that have it in any of their texts."""
    matching = {}
    for name, entry in sorted(entries.items()):
        if entry.problem is None and _has(word, kind, name, _summary(entry.part), entry.plugin.name):
            matching[name] = entry
    return matching


def _summaries(entries: Mapping[str, Entry]) -> dict[str, dict[str, str]]:
    """Return first line and plugin of parts, by name, as plain data."""
    return {name: {"summary": _summary(entry.part), "plugin": entry.plugin.name} for name, entry in entries.items()}


def _print_parts(parts: Mapping[str, Mapping[str, Entry]]) -> None:
    """Print a heading for each kind, and a line for each of its parts, in columns."""
    width = max(len(name) for entries in parts.values() for name in entries)
    for kind, entries in parts.items():
        typer.echo(f"[{kind}.*]")
        for name, entry in entries.items():
            typer.echo(f"  {name:<{width}}  {_summary(entry.part)}  ({entry.plugin.name})")


def list_plugins(registry: Registry, as_json: bool) -> None:
    """Print the interface that each plugin states, and the names that go, or are not promised, which it uses."""
    rows = [_plugin_row(plugin) for plugin in registry.plugins if plugin.place]
    if as_json:
        print_json({"interface": API, "plugins": rows, "notices": registry.notices})
        return
    typer.echo(f"interface {API} of palpate")
    for row in rows:
        interface = "states no interface" if row["interface"] is None else f"interface {row['interface']}"
        typer.echo(f"  {row['name']}: {interface}")
        for use in row["deprecated"]:
            removal = f"{use['name']} ({use['place']}) goes in {use['gone_in']}"
            typer.echo(f"    {removal}: import from {use['replacement']}")
        for use in row["not_promised"]:
            typer.echo(f"    {use['name']} ({use['place']}) is not promised: it may change with any version")
    for notice in registry.notices:
        typer.echo(notice, err=True)


def _plugin_row(plugin: Any) -> dict[str, Any]:
    """Return a plugin as plain data; palpate's own uses of its names are not listed."""
    row: dict[str, Any] = {"name": plugin.name, "interface": plugin.api, "deprecated": [], "not_promised": []}
    if not plugin.own:
        row["deprecated"] = [asdict(use) for use in deprecated_uses(plugin.place)]
        row["not_promised"] = [asdict(use) for use in unpromised_uses(plugin.place)]
    return row


def _has(word: str | None, *texts: str) -> bool:
    """Return True without a word, or if one of the texts has it, in capitals or not."""
    return word is None or any(word.lower() in text.lower() for text in texts)


def _summary(part: type[Part]) -> str:
    """Return the first line of a part's docstring; empty without one."""
    return (inspect.getdoc(part) or "").splitlines()[0] if part.__doc__ else ""
