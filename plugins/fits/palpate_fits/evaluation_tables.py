"""Tables of fits that were evaluated on other logs, and of fits of each cycle."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from palpate_engine import display_unit
from palpate_kit.terminal.quantities import value_with_uncertainty
from palpate_kit.terminal.table import Table

if TYPE_CHECKING:
    from rich.console import RenderableType


def evaluation(rows: Sequence[dict[str, Any]]) -> RenderableType:
    """Residual sum of squares of every fit on every log."""
    from rich.table import Table

    logs = list(dict.fromkeys(row["on"] for row in rows))
    table = Table(title="residual N^2 (RMS N) of what was fitted on one log on the others", title_justify="left")
    table.add_column("track")
    table.add_column("fitted on")
    for log in logs:
        table.add_column(f"on {log}", justify="right")
    for track, source in dict.fromkeys((row["track"], row["fitted_on"]) for row in rows):
        cells = {row["on"]: row for row in rows if (row["track"], row["fitted_on"]) == (track, source)}
        table.add_row(track, source, *(_left(cells.get(log)) for log in logs))
    return table


def _left(row: dict[str, Any] | None) -> str:
    if row is None or row["rss"] is None:
        return "-"
    return f"{row['rss']:.4g} ({row['rms']:.3g})"


def by_cycle(rows: Sequence[dict[str, Any]]) -> RenderableType:
    """One row for each cycle: what was looked for, its residual and its flags."""
    units = {name: known["unit"] for row in rows for name, known in row["unknowns"].items() if known["free"]}
    heads = [f"{name}\n{display_unit(unit)[0]}" for name, unit in units.items()]
    cells = []
    for row in rows:
        free = {name: known for name, known in row["unknowns"].items() if known["free"]}
        values = [_cycle_value(free.get(name)) if free else "not fitted" for name in units]
        codes = " ".join(sorted({flag["code"] for flag in row["flags"]}))
        rms = "-" if row["rms"] is None else f"{row['rms']:.4g}"
        cells.append([row["log"], row["track"], str(row["cycle"]), *values, rms, codes])
    left = ["log", "track", "cycle", "flags"]
    return Table.of("every cycle by itself", [*left[:3], *heads, "RMS\nN", "flags"], cells, left).view()


def _cycle_value(known: dict[str, Any] | None) -> str:
    if known is None:
        return ""
    factor = display_unit(known["unit"])[1]
    return value_with_uncertainty(known["value"] * factor, (known["std"] or 0.0) * factor)
