"""``palpate list``: every part that a pipeline can name."""

from __future__ import annotations

import inspect

import typer
from palpate import Part
from palpate_engine import registry as registries
from palpate_kit.terminal.json_output import print_json
from palpate_kit.terminal.options import JsonOption


def list_parts(as_json: JsonOption = False) -> None:
    """List every part that a pipeline can name, by kind, with the plugin it comes from."""
    registry = registries.load()
    every = {kind: sorted(entries.items()) for kind, entries in registry.parts.items()}
    usable = {kind: [(name, entry) for name, entry in every[kind] if entry.problem is None] for kind in every}
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
    problems = [entry.problem for entries in every.values() for _, entry in entries if entry.problem is not None]
    for notice in (*registry.notices, *problems):
        typer.echo(notice, err=True)


def _summary(part: type[Part]) -> str:
    return (inspect.getdoc(part) or "").splitlines()[0] if part.__doc__ else ""
