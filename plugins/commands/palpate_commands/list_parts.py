"""``palpate list``: every part that a pipeline can name."""

from __future__ import annotations

import inspect
from dataclasses import asdict
from typing import Annotated, Any

import typer
from palpate import API, ConfigurationError, Part, suggest
from palpate_engine import Registry, deprecated_uses, registry as registries, unpromised_uses
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
    sorted_parts = {kind: sorted(entries.items()) for kind, entries in registry.parts.items()}
    usable = {
        kind: [
            (name, entry)
            for name, entry in entries
            if entry.problem is None and _has(word, kind, name, _summary(entry.part), entry.plugin.name)
        ]
        for kind, entries in sorted_parts.items()
    }
    if word is not None:
        usable = {kind: entries for kind, entries in usable.items() if entries}
        if not usable:
            names = [*sorted_parts, *(name for entries in sorted_parts.values() for name, _ in entries)]
            raise ConfigurationError(f"no part has the word {word!r}{suggest(word, names)}")
    if as_json:
        print_json(
            {
                kind: {name: {"summary": _summary(entry.part), "plugin": entry.plugin.name} for name, entry in entries}
                for kind, entries in usable.items()
            }
        )
    else:
        width = max(len(name) for entries in usable.values() for name, _ in entries)
        for kind, entries in usable.items():
            typer.echo(f"[{kind}.*]")
            for name, entry in entries:
                typer.echo(f"  {name:<{width}}  {_summary(entry.part)}  ({entry.plugin.name})")
    problems = [entry.problem for entries in sorted_parts.values() for _, entry in entries]
    for notice in (*registry.notices, *(problem for problem in problems if problem is not None)):
        typer.echo(notice, err=True)


def list_plugins(registry: Registry, as_json: bool) -> None:
    """Print the interface that each plugin states, and the names that go, or are not promised, which it uses."""
    rows: list[dict[str, Any]] = [
        {
            "name": plugin.name,
            "interface": plugin.api,
            "deprecated": [asdict(use) for use in deprecated_uses(plugin.place)] if not plugin.own else [],
            "not_promised": [asdict(use) for use in unpromised_uses(plugin.place)] if not plugin.own else [],
        }
        for plugin in registry.plugins
        if plugin.place
    ]
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


def _has(word: str | None, *texts: str) -> bool:
    return word is None or any(word.lower() in text.lower() for text in texts)


def _summary(part: type[Part]) -> str:
    return (inspect.getdoc(part) or "").splitlines()[0] if part.__doc__ else ""
