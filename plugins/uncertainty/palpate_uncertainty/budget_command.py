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

_MIN_PERCENT = 5e-3  # per cent; less is shown as such
_MIN_DRAWS = 4  # draws of a Monte Carlo budget, for a standard deviation of them


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
    layout: FormatOption = "table",
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
    drawn = {} if monte_carlo is None else _draws(run, list(chosen), monte_carlo, seed)
    if as_json:
        tables: dict[str, Any] = {name: found["budget"] for name, found in chosen.items()}
        for name, found in drawn.items():
            facts = {"draws": monte_carlo, "seed": seed, "lost": found.lost, "parameters": found.table()}
            tables[name] = {"budget": tables[name], "monte_carlo": facts}
        typer.echo(json.dumps(tables, indent=2))
        return
    screen = console(120) if details else console()
    for name, found in chosen.items():
        screen.print(_view(name, found) if details else _shares(name, found).view())
        with open_table(run / RESULT, f"tracks.{name}.diagnoses.one-frequency"):
            lines = list(_at_one_frequency(found.get("diagnoses", {}).get("one-frequency")))
        with open_table(run / RESULT, f"tracks.{name}.diagnoses.assumptions"):
            skin = skin_conditions(found.get("diagnoses", {}).get("assumptions", {}))
        lines += [f"not included, but assumed: {', '.join(skin)}"] if skin else []
        for line in lines:
            screen.print(line)
    for found in drawn.values():
        _print_draws(screen, found, seed)


def _draws(run: Path, tracks: list[str], draws: int, seed: int) -> dict[str, PropagatedDraws]:
    """The draws of every track, with progress."""
    from palpate_uncertainty.monte_carlo import cases, propagate_draws

    if draws < _MIN_DRAWS:
        raise ConfigurationError(f"--monte-carlo: {draws} draws are too few; at least {_MIN_DRAWS} are needed")
    found = {}
    for case in cases(run, tracks):
        with progress(case.name, "draws", draws):
            found[case.name] = propagate_draws(case, draws, seed, report=report_progress)
    return found


def _print_draws(screen: Any, found: PropagatedDraws, seed: int) -> None:
    """The draws of one track next to the budget."""
    screen.print(f"\n{len(found.values)} draws, seed {seed}{f', {found.lost} without an estimate' * (found.lost > 0)}")
    for name, row in found.table().items():
        shown = {key: _shown(value, found.parameters[name]["unit"]) for key, value in row.items() if value is not None}
        ratio = f" (ratio {row['std'] / row['combined']:.2f})" if row["combined"] else ""
        linear = shown.get("combined", "?")
        screen.print(f"{found.name} {name}: u {linear} by the budget, {shown['std']} by the draws{ratio}")
        screen.print(f"  mean {shown['mean']}, 95 % from {shown['low']} to {shown['high']}; value {shown['value']}")


def _shares(name: str, found: Mapping[str, Any]) -> Table:
    """Sources of one track, the largest first: standard uncertainty, and what it gives each value in per cent."""
    parameters = found["parameters"]
    heads = [f"{parameter}\n%" for parameter in parameters]
    rows = sorted(found["budget"], key=lambda row: -_largest(row["effects"].values()))
    cells = [
        [
            row["source"],
            *_number_and_unit(row["std"], row["unit"]),
            *(_percent((row["effects"].get(parameter) or {}).get("percent")) for parameter in parameters),
        ]
        for row in rows
    ]
    cells.append(["combined", "", "", *(_percent(_share(value)) for value in parameters.values())])
    shown = [
        f"{parameter} {'?' if (number := estimate_of(value)) is None else _shown(number, value['unit'])}"
        for parameter, value in parameters.items()
    ]
    return Table.of(f"{name}: {', '.join(shown)}", ["source", "u", "unit", *heads], cells, ["source", "unit"])


def _number_and_unit(std: float | None, unit: str) -> tuple[str, str]:
    if std is None:
        return "", ""
    written, factor = display_unit(unit)
    return f"{std * factor:.3g}", "" if written == "1" else written


def _largest(effects: Iterable[Mapping[str, Any] | None]) -> float:
    """The largest share of a source in any value; one that is not known counts most."""
    shares = [effect["percent"] for effect in effects if effect]
    return max((math.inf if share is None else share for share in shares), default=0.0)


def _share(value: Mapping[str, Any]) -> float | None:
    if value["combined"] is None or not (number := estimate_of(value)):
        return None
    return 100 * float(value["combined"]) / abs(number)


def _percent(share: float | None) -> str:
    return "?" if share is None else "< 0.005" if share < _MIN_PERCENT else f"{share:.2g}"


def _view(name: str, found: Mapping[str, Any]) -> Any:
    """A table of one track: sources by rows, values by columns; each contribution in the value's unit and per cent."""
    from rich.table import Table

    parameters = found["parameters"]
    table = Table(title=f"{name}: contributions to the standard uncertainty", title_justify="left")
    table.add_column("source")
    table.add_column("u", justify="right")
    for parameter, value in parameters.items():
        shown = "?" if (number := estimate_of(value)) is None else _shown(number, value["unit"])
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


def _at_one_frequency(found: Mapping[str, Any] | None) -> Iterator[str]:
    """The note that no row can show: a viscosity found at one frequency is that of this frequency."""
    if found is None:
        return
    time = f"{1e3 * found['time']:.3g} ms"
    relaxed = f"If a tenth of the stiffness relaxed within {time}, that would be"
    for name, like in found["looks_like"].items():
        yield (
            f"not included: this is the {name} at {found['frequency']:.3g} Hz. {relaxed} "
            f"{_shown(like['value'], like['unit'])} of it without a trace in the residual; "
            "only another frequency shows it"
        )


def _corrected(value: Mapping[str, Any]) -> str:
    """The value less its known bias, with the remaining uncertainty."""
    if value.get("corrected") is None:
        return ""
    combined = value.get("corrected_combined")
    std = "?" if combined is None else _shown(combined, value["unit"])
    return f"{_shown(value['corrected'], value['unit'])} +- {std}"


def _cell(effect: Mapping[str, Any] | None, unit: str) -> str:
    if effect is None or effect["contribution"] is None:
        return ""
    share = effect["percent"]
    per_cent = "" if share is None else " (< 0.005 %)" if share < _MIN_PERCENT else f" ({share:.2g} %)"
    return f"{_shown(effect['contribution'], unit)}{per_cent}"


def _combined(value: Mapping[str, Any]) -> str:
    if value["combined"] is None or not (number := estimate_of(value)):
        return "?"
    return f"{_shown(value['combined'], value['unit'])} ({100 * value['combined'] / abs(number):.2g} %)"


def _shown(value: float, unit: str) -> str:
    """A number in display units."""
    written, scale = display_unit(unit)
    return f"{value * scale:.3g} {written}".removesuffix(" 1").rstrip()
