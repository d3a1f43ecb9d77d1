"""``palpate report budget``: what the uncertainty of a run's values is made of."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from palpate import ConfigurationError, suggest
from palpate_engine import RESULT, display_unit
from palpate_kit.runs.result_file import estimate_of, open_table
from palpate_kit.runs.run_folder import RunFolder
from palpate_kit.terminal.options import DetailsOption, FormatOption, JsonOption
from palpate_kit.terminal.progress import progress, report_progress
from palpate_kit.terminal.table import Table, console

from palpate_uncertainty.assumption_line import skin_conditions

if TYPE_CHECKING:
    from palpate_uncertainty.monte_carlo import PropagatedDraws

# Of the screen alone: no verdict depends on them.
_MIN_PERCENT = 5e-3  # per cent (choice); less is shown as such
_MIN_DRAWS = 4  # draws of a Monte Carlo budget (choice), for a standard deviation of them
_DETAILS_WIDTH = 120  # characters of the table of contributions


def budget(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A run folder.")],
    track: Annotated[str | None, typer.Option(help="Track, such as dr/fit. [default: all]")] = None,
    as_json: JsonOption = False,
    details: DetailsOption = False,
    monte_carlo: Annotated[
        int | None,
        typer.Option(metavar="N", help="Draw every declared input N times and estimate again (GUM Supplement 1)."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Of the draws.")] = 0,
    layout: FormatOption = "table",  # set for all tables by the option's callback
) -> None:
    """Every source of uncertainty of a run, and what it contributes to each value."""
    tracks = _tracks_with_budget(run, track)
    # With --monte-carlo the draws stand next to the budget.
    draws_by_track = {} if monte_carlo is None else _draws(run, list(tracks), monte_carlo, seed)
    if as_json:
        document: dict[str, Any] = {name: table["budget"] for name, table in tracks.items()}
        for name, draws in draws_by_track.items():
            facts = {"draws": monte_carlo, "seed": seed, "lost": draws.lost, "parameters": draws.table()}
            document[name] = {"budget": document[name], "monte_carlo": facts}
        typer.echo(json.dumps(document, indent=2))
        return
    screen = console(_DETAILS_WIDTH) if details else console()
    for name, table in tracks.items():
        screen.print(_view(name, table) if details else _shares(name, table).view())
        for line in _notes(run, name, table):
            screen.print(line)
    for draws in draws_by_track.values():
        _print_draws(screen, draws, seed)


def _tracks_with_budget(run: Path, track: str | None) -> dict[str, Any]:
    """Return the results of a track, by default of all, by name.

    Raises ConfigurationError for a track that the run does not have, or without a budget.
    """
    results: Mapping[str, Any] = RunFolder(run).result["tracks"]
    if track is not None and track not in results:
        raise ConfigurationError(f"{run}: has no track {track!r}{suggest(track, results)}")
    tracks = {name: table for name, table in results.items() if track in (None, name)}
    without_budget = [name for name, table in tracks.items() if "budget" not in table]
    if without_budget:
        verb = "has" if len(without_budget) == 1 else "have"
        raise ConfigurationError(
            f"{run}: {', '.join(without_budget)} {verb} no budget: the run is of an earlier version; replay it"
        )
    return tracks


def _notes(run: Path, name: str, track: Mapping[str, Any]) -> list[str]:
    """Return the lines on what no row of a track's table can show."""
    diagnoses = track.get("diagnoses", {})
    with open_table(run / RESULT, f"tracks.{name}.diagnoses.one-frequency"):
        lines = list(_at_one_frequency(diagnoses.get("one-frequency")))
    with open_table(run / RESULT, f"tracks.{name}.diagnoses.assumptions"):
        skin = skin_conditions(diagnoses.get("assumptions", {}))
    return lines + ([f"not included, but assumed: {', '.join(skin)}"] if skin else [])


def _draws(run: Path, tracks: list[str], draws: int, seed: int) -> dict[str, PropagatedDraws]:
    """Return the draws of every track, by name, with progress."""
    from palpate_uncertainty.monte_carlo import cases, propagate_draws

    if draws < _MIN_DRAWS:
        raise ConfigurationError(f"--monte-carlo: {draws} draws are too few; at least {_MIN_DRAWS} are needed")
    by_track = {}
    for case in cases(run, tracks):
        with progress(case.name, "draws", draws):
            by_track[case.name] = propagate_draws(case, draws, seed, report=report_progress)
    return by_track


def _print_draws(screen: Any, draws: PropagatedDraws, seed: int) -> None:
    """Print the draws of one track next to the budget."""
    lost = f", {draws.lost} without an estimate" * (draws.lost > 0)
    screen.print(f"\n{len(draws.values)} draws, seed {seed}{lost}")
    for name, row in draws.table().items():
        unit = draws.parameters[name]["unit"]
        texts = {key: _shown(value, unit) for key, value in row.items() if value is not None}
        ratio = f" (ratio {row['std'] / row['combined']:.2f})" if row["combined"] else ""
        linear = texts.get("combined", "?")
        screen.print(f"{draws.name} {name}: u {linear} by the budget, {texts['std']} by the draws{ratio}")
        screen.print(f"  mean {texts['mean']}, 95 % from {texts['low']} to {texts['high']}; value {texts['value']}")


def _shares(name: str, track: Mapping[str, Any]) -> Table:
    """Return the sources of one track, the largest first: standard uncertainty, and its per cent of each value."""
    parameters = track["parameters"]
    cells = []
    for row in sorted(track["budget"], key=lambda row: -_largest(row["effects"].values())):
        effects = [row["effects"].get(parameter) or {} for parameter in parameters]
        shares = [_percent(effect.get("percent")) for effect in effects]
        cells.append([row["source"], *_number_and_unit(row["std"], row["unit"]), *shares])
    cells.append(["combined", "", "", *(_percent(_share(value)) for value in parameters.values())])
    heads = [f"{parameter}\n%" for parameter in parameters]
    texts = [f"{parameter} {_estimate_text(value)}" for parameter, value in parameters.items()]
    return Table.of(f"{name}: {', '.join(texts)}", ["source", "u", "unit", *heads], cells, ["source", "unit"])


def _estimate_text(value: Mapping[str, Any]) -> str:
    """Return the estimate of a parameter in display units; a question mark without one."""
    estimate = estimate_of(value)
    return "?" if estimate is None else _shown(estimate, value["unit"])


def _number_and_unit(std: float | None, unit: str) -> tuple[str, str]:
    """Return a standard uncertainty and its unit for display; empty without one."""
    if std is None:
        return "", ""
    symbol, factor = display_unit(unit)
    return f"{std * factor:.3g}", "" if symbol == "1" else symbol


def _largest(effects: Iterable[Mapping[str, Any] | None]) -> float:
    """Return the largest share of a source in any value; an unknown one counts most."""
    shares = [effect["percent"] for effect in effects if effect]
    return max((math.inf if share is None else share for share in shares), default=0.0)


def _share(value: Mapping[str, Any]) -> float | None:
    """Return the combined uncertainty in per cent of a value; None if either is unknown."""
    if value["combined"] is None or not (number := estimate_of(value)):
        return None
    return 100 * float(value["combined"]) / abs(number)


def _percent(share: float | None) -> str:
    """Return a share in per cent as a cell."""
    return "?" if share is None else "< 0.005" if share < _MIN_PERCENT else f"{share:.2g}"


def _view(name: str, track: Mapping[str, Any]) -> Any:
    """Return the table of one track: sources by rows, values by columns, each contribution with its per cent."""
    from rich.table import Table

    parameters = track["parameters"]
    table = Table(title=f"{name}: contributions to the standard uncertainty", title_justify="left")
    table.add_column("source")
    table.add_column("u", justify="right")
    for parameter, value in parameters.items():
        table.add_column(f"{parameter}\n{_estimate_text(value)}", justify="right")
    units = {parameter: value["unit"] for parameter, value in parameters.items()}
    for row in track["budget"]:
        std = "" if row["std"] is None else _shown(row["std"], row["unit"])
        cells = [_cell(row["effects"].get(parameter), unit) for parameter, unit in units.items()]
        table.add_row(row["source"], std, *cells)
    table.add_section()
    table.add_row("combined", "", *(_combined(value) for value in parameters.values()))
    if any(value.get("corrected") is not None for value in parameters.values()):
        table.add_row("corrected value", "", *(_corrected(value) for value in parameters.values()))
    return table


def _at_one_frequency(table: Mapping[str, Any] | None) -> Iterator[str]:
    """Yield the note that a viscosity estimated at one frequency is that of this frequency."""
    if table is None:
        return
    time = f"{1e3 * table['time']:.3g} ms"
    relaxed = f"If a tenth of the stiffness relaxed within {time}, that would be"
    for name, like in table["looks_like"].items():
        yield (
            f"not included: this is the {name} at {table['frequency']:.3g} Hz. {relaxed} "
            f"{_shown(like['value'], like['unit'])} of it without a trace in the residual; "
            "only another frequency shows it"
        )


def _corrected(value: Mapping[str, Any]) -> str:
    """Return the value less its known bias, with the remaining uncertainty."""
    if value.get("corrected") is None:
        return ""
    combined = value.get("corrected_combined")
    std = "?" if combined is None else _shown(combined, value["unit"])
    return f"{_shown(value['corrected'], value['unit'])} +- {std}"


def _cell(effect: Mapping[str, Any] | None, unit: str) -> str:
    """Return the contribution of a source to a value, with its per cent; empty without one."""
    if effect is None or effect["contribution"] is None:
        return ""
    share = effect["percent"]
    per_cent = "" if share is None else " (< 0.005 %)" if share < _MIN_PERCENT else f" ({share:.2g} %)"
    return f"{_shown(effect['contribution'], unit)}{per_cent}"


def _combined(value: Mapping[str, Any]) -> str:
    """Return the combined uncertainty of a value, with its per cent."""
    if value["combined"] is None or not (number := estimate_of(value)):
        return "?"
    return f"{_shown(value['combined'], value['unit'])} ({100 * value['combined'] / abs(number):.2g} %)"


def _shown(value: float, unit: str) -> str:
    """Return a number in display units."""
    symbol, factor = display_unit(unit)
    return f"{value * factor:.3g} {symbol}".removesuffix(" 1").rstrip()
