"""``palpate material card``: a fitted law as a card for Abaqus, ANSYS, FEBio or COMSOL."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from palpate import LogError
from palpate.host import write_new

from palpate_reference.cards.card_formats import FORMATS, Program
from palpate_reference.cards.prony_series import MATERIAL, PronySeries, series_of_fit

_SAME = 1e-9  # relative error of what is read back


def card(
    fit: Annotated[Path, typer.Argument(metavar="FIT", help="Folder of `palpate material fit`; or a card.")],
    program: Annotated[Program, typer.Option("--to", help="Program that the card is for.")],
    law: Annotated[str | None, typer.Option(help="Law. [default: the best that is a Prony series]")] = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="File to write. [default: printed]")] = None,
) -> None:
    """Write a neo-Hookean solid with a Prony series, in Pa and s, its uncertainties as comments.

    What was written is read again and compared. Cards of the four programs are read as well, to turn one into another.
    """
    series = read_series(fit, law)
    text = FORMATS[program].text(series)
    _demand_round_trip(series, FORMATS[program].series(text), program)
    if out is None:
        typer.echo(text, nl=False)
        return
    write_new(out, text)
    typer.echo(f"the card is in {out}")


def read_series(path: Path, law: str | None) -> PronySeries:
    """The series of a fit, by its folder or file, or of a card; raises UserError."""
    path = path / MATERIAL if path.is_dir() else path
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise LogError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from error
    for name, form in FORMATS.items():
        if form.sign in text.upper() or form.sign in text:
            try:
                return form.series(text)
            except (ValueError, KeyError, IndexError) as error:
                raise LogError(f"{path}: is not a whole card of {name} with a Prony series: {error!r}") from error
    return series_of_fit(path, law)


def _demand_round_trip(series: PronySeries, back: PronySeries, program: str) -> None:
    """Raise RuntimeError, a fault of ours, where a card does not say what it should."""
    pairs = [(series.lasting, back.lasting), *zip(sum(series.arms, ()), sum(back.arms, ()), strict=True)]
    if any(abs(one - other) > _SAME * max(series.instant, abs(one)) for one, other in pairs):
        raise RuntimeError(f"the card of {program} reads back as {back}, not {series}")
