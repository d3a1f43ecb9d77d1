"""Values of the commands' options."""

from __future__ import annotations

from typing import Annotated

import typer
from palpate import ConfigurationError, to_si

SurfaceOption = Annotated[
    str | None, typer.Option(help="Height of the skin, such as '0.3 mm'. [default: that of the track, or as fitted]")
]


def quantities(text: str | None, unit: str, option: str) -> list[float]:
    """Quantities [SI] with commas between; raises ConfigurationError."""
    try:
        return [to_si(part.strip(), unit) for part in text.split(",")] if text is not None else []
    except ValueError as error:
        raise ConfigurationError(f"{option}: {error}") from error


def height_of(surface: str | None) -> float | None:
    """Return the height [m] that `--surface` gives; raises ConfigurationError."""
    found = quantities(surface, "m", "--surface")
    if len(found) > 1:
        raise ConfigurationError(f"--surface: one height, not {len(found)}")
    return found[0] if found else None
