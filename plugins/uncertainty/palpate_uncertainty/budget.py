"""``palpate budget``: what the uncertainty of a run's values is made of."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer
from palpate import ConfigurationError
from palpate.host import JsonOption, RunFolder, console, people, suggest

_LEAST = 5e-3  # per cent; less is shown as such


def budget(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A run folder.")],
    track: Annotated[str | None, typer.Option(help="Track, such as dr/fit. [default: all]")] = None,
    as_json: JsonOption = False,
) -> None:
    """Every source of uncertainty of a run, and what it contributes to each value."""
    tracks: Mapping[str, Any] = RunFolder(run).result["tracks"]
    if track is not None and track not in tracks:
        raise ConfigurationError(f"{run}: has no track {track!r}{suggest(track, tracks)}")
    chosen = {name: found for name, found in tracks.items() if track in (None, name)}
    without = [name for name, found in chosen.items() if "budget" not in found]
    if without:
        raise ConfigurationError(
            f"{run}: {', '.join(without)} has no budget: the run is of an earlier version; replay it"
        )
    if as_json:
        typer.echo(json.dumps({name: found["budget"] for name, found in chosen.items()}, indent=2))
        return
    screen = console()
    for name, found in chosen.items():
        screen.print(_view(name, found))


def _view(name: str, found: Mapping[str, Any]) -> Any:
    """A table of one track: sources by rows, values by columns; each contribution in the value's unit and per cent."""
    from rich.table import Table

    parameters = found["parameters"]
    table = Table(title=f"{name}: contributions to the standard uncertainty", title_justify="left")
    table.add_column("source")
    table.add_column("u", justify="right")
    for parameter, value in parameters.items():
        shown = "?" if value["value"] is None else _shown(value["value"], value["unit"])
        table.add_column(f"{parameter}\n{shown}", justify="right")
    for row in found["budget"]:
        std = "" if row["std"] is None else _shown(row["std"], row["unit"])
        cells = [_cell(row["effects"].get(name), value["unit"]) for name, value in parameters.items()]
        table.add_row(row["source"], std, *cells)
    table.add_section()
    table.add_row("combined", "", *(_combined(value) for value in parameters.values()))
    if any(value.get("corrected") is not None for value in parameters.values()):
        table.add_row("corrected value", "", *(_corrected(value) for value in parameters.values()))
    return table


def _corrected(value: Mapping[str, Any]) -> str:
    """The value less its known bias, with the uncertainty that is left."""
    if value.get("corrected") is None:
        return ""
    return f"{_shown(value['corrected'], value['unit'])} +- {_shown(value['corrected_combined'], value['unit'])}"


def _cell(effect: Mapping[str, Any] | None, unit: str) -> str:
    if effect is None or effect["contribution"] is None:
        return ""
    share = effect["percent"]
    per_cent = "" if share is None else " (< 0.005 %)" if share < _LEAST else f" ({share:.2g} %)"
    return f"{_shown(effect['contribution'], unit)}{per_cent}"


def _combined(value: Mapping[str, Any]) -> str:
    if value["combined"] is None or not value["value"]:
        return "?"
    return f"{_shown(value['combined'], value['unit'])} ({100 * value['combined'] / abs(value['value']):.2g} %)"


def _shown(value: float, unit: str) -> str:
    """A number in the unit that people write."""
    written, scale = people(unit)
    return f"{value * scale:.3g} {written}".removesuffix(" 1").rstrip()
