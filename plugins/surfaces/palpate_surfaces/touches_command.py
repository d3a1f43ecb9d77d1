"""``palpate calibrate touches``: the touches of runs as a table, for a surface that is made of them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from palpate import OutputError

from palpate_surfaces.touches import read_touches, touches_table


def touches(
    runs: Annotated[list[Path], typer.Argument(help="Run folders; tables of touches join them.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="File to write.")] = Path("touches.csv"),
) -> None:
    """Write the touches of runs as a table: where each palpation that stays at its place met the skin, and how well.

    For `touches` of a [surface.NAME] of type touched, or for `palpate calibrate surface`.
    """
    skin_touches = read_touches(runs)
    try:
        output.write_text(touches_table(skin_touches), encoding="utf-8")
    except OSError as error:
        raise OutputError(f"{output}: cannot write: {error.strerror}") from error
    typer.echo(f"{len(skin_touches)} touches, known to {1e3 * float(skin_touches.std.max()):.2g} mm; wrote {output}")
