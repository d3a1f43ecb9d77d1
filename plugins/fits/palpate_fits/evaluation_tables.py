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
    """Return the table of the residual sum of squares of every fit on every log."""
    from rich.table import Table

    logs = list(dict.fromkeys(row["on"] for row in rows))
    table = Table(title="residual N^2 (RMS N) of what was fitted on one log on the others", title_justify="left")
    table.add_column("track")
    table.add_column("fitted on")
    for log in logs:
        table.add_column(f"on {log}", justify="right")
    for track, source in dict.fromkeys((row["track"], row["fitted_on"]) for row in rows):
        cells = {row["on"]: row for row in rows if (row["track"], row["fitted_on"]) == (track, source)}
        table.add_row(track, source, *(_residual_text(cells.get(log)) for log in logs))
    return table


def _residual_text(row: dict[str, Any] | None) -> str:
    """Return sum of squares [N^2] and RMS [N] of a row as text; a dash without them."""
    if row is None or row["rss"] is None:
        return "-"
    return f"{row['rss']:.4g} ({row['rms']:.3g})"


def by_cycle(rows: Sequence[dict[str, Any]]) -> RenderableType:
    """Return the table of cycles, a row each: the free unknowns, the RMS of the residual, and the flags."""
    units = {name: unknown["unit"] for row in rows for name, unknown in row["unknowns"].items() if unknown["free"]}
    headings = [f"{name}\n{display_unit(unit)[0]}" for name, unit in units.items()]
    cells = []
    for row in rows:
        free = {name: unknown for name, unknown in row["unknowns"].items() if unknown["free"]}
        values = [_cycle_value(free.get(name)) if free else "not fitted" for name in units]
        codes = " ".join(sorted({flag["code"] for flag in row["flags"]}))
        rms = "-" if row["rms"] is None else f"{row['rms']:.4g}"
        cells.append([row["log"], row["track"], str(row["cycle"]), *values, rms, codes])
    labels = ["log", "track", "cycle"]
    columns = [*labels, *headings, "RMS\nN", "flags"]
    return Table.of("every cycle by itself", columns, cells, [*labels, "flags"]).view()


def _cycle_value(unknown: dict[str, Any] | None) -> str:
    """Return a free unknown with its uncertainty as text, in its display unit; nothing where it is not free."""
    if unknown is None:
        return ""
    factor = display_unit(unknown["unit"])[1]
    return value_with_uncertainty(unknown["value"] * factor, (unknown["std"] or 0.0) * factor)
