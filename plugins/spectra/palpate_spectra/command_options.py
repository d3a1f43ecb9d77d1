"""Values of the commands' options."""

from __future__ import annotations

from typing import Annotated

import typer
from palpate import ConfigurationError, to_si

SurfaceOption = Annotated[
    str | None, typer.Option(help="Height of the skin, such as '0.3 mm'. [default: that of the track, or as fitted]")
]


def parse_quantities(text: str | None, unit: str, option: str) -> list[float]:
    """Return the quantities [SI] in a text such as "0.5 Hz, 2 Hz", for an option; raises ConfigurationError."""
    try:
        return [to_si(part.strip(), unit) for part in text.split(",")] if text is not None else []
    except ValueError as error:
        raise ConfigurationError(f"{option}: {error}") from error


def parse_height(surface: str | None) -> float | None:
    """Return the height [m] that `--surface` states, None without one; raises ConfigurationError."""
    heights = parse_quantities(surface, "m", "--surface")
    if len(heights) > 1:
        raise ConfigurationError(f"--surface: one height, not {len(heights)}")
    return heights[0] if heights else None
