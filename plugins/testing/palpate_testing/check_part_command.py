"""``palpate check part``: a part tried in simulation, as one page that its author can publish."""

from __future__ import annotations

import inspect
import json
import platform
from collections.abc import Callable, Iterator, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import typer
from palpate import ConfigurationError, OutputError, Part, PluginError, suggest
from palpate_engine import Entry, Registry, Source, build_parts, plain_settings, registry as registries

from palpate_testing.discovery_checks import slow_imports
from palpate_testing.part_measures import (
    CHECKED_KINDS,
    Measures,
    measure_device,
    measure_estimator,
    measure_model,
    measure_surface,
    measure_tip,
    measure_trajectory,
)

STANDARD_TIP = '{type = "sphere", radius = "5 mm"}'
MEASURES: Mapping[str, Callable[[Any], Measures]] = {
    "indenter": measure_tip,
    "model": measure_model,
    "estimator": measure_estimator,
    "trajectory": measure_trajectory,
    "surface": measure_surface,
    "device": measure_device,
}


def check_part(
    name: Annotated[str, typer.Argument(help="Name of a part, as in `palpate list`.")],
    settings: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="A key of the part; can be repeated.")
    ] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Write the page to this file.")] = None,
) -> None:
    """Check a part in simulation and print what was tried and measured, as a page in Markdown.

    Nothing real is connected to: an arm is checked in simulated time against the twin that stands in for it, and a
    device that has none is refused. A part that fails has no page.
    """
    registry = registries.load()
    group, part = _build_part(name, settings or [], registry)
    text = page_of(group, part, registry)
    if output is None:
        typer.echo(text, nl=False)
        return
    try:
        output.write_text(text, encoding="utf-8")
    except OSError as error:
        raise OutputError(f"{output}: cannot write: {error.strerror}") from error
    typer.echo(f"written to {output}")


def _build_part(name: str, settings: list[str], registry: Registry) -> tuple[str, Part]:
    """Return group and part of a name, with settings KEY=VALUE; a model that needs a tip gets a sphere of 5 mm.

    Raises ConfigurationError with a suggestion for a name without a part that can be checked.
    """
    group, full_name = _find_part(name, registry)
    source = Source(f"[{group}.part]\ntype = {json.dumps(full_name)}\n", Path("palpate check part"))
    tip = registry.find(group, full_name).model_fields.get("indenter")
    if tip is not None and tip.is_required() and not any(text.startswith("indenter") for text in settings):
        source.override(f"{group}.part.indenter={STANDARD_TIP}")
    for text in settings:
        source.override(f"{group}.part.{text}")
    return group, build_parts(source, group, registry)["part"]


def _find_part(name: str, registry: Registry) -> tuple[str, str]:
    """Return the first group that has a part of a name, and its full name there; raises ConfigurationError."""
    names = {}
    for group in CHECKED_KINDS:
        try:
            names[group] = registry.named(group, name)
        except ConfigurationError:
            continue
    if not names:
        all_names = [key for group in CHECKED_KINDS for key in registry.parts[group]]
        raise ConfigurationError(f"no part {name!r} that can be checked{suggest(name, all_names)}")
    return next(iter(names.items()))


def page_of(group: str, part: Part, registry: Registry) -> str:
    """Return the page of a part of a group, such as "model", in Markdown; raises PluginError where its check fails."""
    entry = next(entry for entry in registry.parts[group].values() if entry.is_of(type(part)))
    try:
        measures = MEASURES[group](part)
    except AssertionError as error:
        raise PluginError(f"plugin {entry.plugin.name}: {group} {entry.name!r}: {error}") from error
    tested_on = f"palpate {version('palpate')}, Python {platform.python_version()}, {platform.machine()}"
    lines = [
        f"# {entry.qualified}: {group} of {entry.plugin.name}",
        "",
        (inspect.getdoc(type(part)) or "").strip(),
        "",
        f"Tested in simulation on {tested_on}; not certified.",
        "",
        "| setting | value (SI) |",
        "|---|---|",
        *(f"| `{key}` | `{json.dumps(setting)}` |" for key, setting in plain_settings(part, registry).items()),
        "",
        f"Passed `{measures.check}`: {measures.tried}",
        "",
        "| measured | value |",
        "|---|---|",
        *(f"| {quantity} | {text} |" for quantity, text in (*measures.rows, *_discovery_row(entry, part))),
    ]
    return "\n".join(lines) + "\n"


def _discovery_row(entry: Entry, part: Part) -> Iterator[tuple[str, str]]:
    """Yield the slow libraries that the module of a third party's installed plugin imports, before every command."""
    if not entry.plugin.own and not entry.plugin.is_file:
        import_lines = slow_imports(type(part).__module__.partition(".")[0])
        libraries = ", ".join(f"{library} ({line})" for library, line in import_lines.items())
        yield "slow libraries that every command imports with it", libraries or "none"
