"""``palpate material card``: a fitted law as a card for Abaqus, ANSYS, FEBio or COMSOL."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from palpate import ConfigurationError, LogError, suggest
from palpate_engine import bounded_text, json_document, write_new

from palpate_reference.cards.card_formats import FORMATS
from palpate_reference.cards.card_text import Program
from palpate_reference.cards.hyperelastic_cards import HYPERELASTIC_CARDS, HyperelasticSolid
from palpate_reference.cards.prony_series import MATERIAL, SERIES, PronySeries, law_remarks, series_of_law
from palpate_reference.hyperelastic.strain_energies import energy_of

_TOLERANCE = 1e-9  # relative, of a number that is read back: cards have twelve digits
_SERIES_MARKS = ("*VISCOELASTIC", "TB,PRONY", "<g0>", "G_inf ")  # of a card that has a Prony series
_PROGRAM_MARKS = {"abaqus": "*HYPERELASTIC", "ansys": "TB,HYPER", "febio": "<material ", "comsol": '[Pa] "'}


def card(
    fit: Annotated[Path, typer.Argument(metavar="FIT", help="Folder of `palpate material fit`; or a card.")],
    program: Annotated[Program, typer.Option("--to", help="Program that the card is for.")],
    law: Annotated[str | None, typer.Option(help="Law. [default: the best that a card can hold]")] = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="File to write. [default: printed]")] = None,
) -> None:
    """Write a neo-Hookean solid with a Prony series, or a hyperelastic solid, in Pa and s.

    Uncertainties are comments. What was written is read again and compared. Cards of the four programs are read as
    well, to turn one into another.
    """
    material = read_material(fit, law)
    if isinstance(material, PronySeries):
        text = FORMATS[program].text(material)
        demand_same(_numbers(material), _numbers(FORMATS[program].series(text)), program)
    else:
        text = HYPERELASTIC_CARDS[program].text(material)
        demand_same(material.values, HYPERELASTIC_CARDS[program].solid(text).values, program)
    if out is None:
        typer.echo(text, nl=False)
        return
    write_new(out, text)
    typer.echo(f"the card is in {out}")


def read_material(path: Path, law: str | None) -> PronySeries | HyperelasticSolid:
    """Return the series or the solid of a fit, by its folder or file, or of a card; raises UserError."""
    file = path / MATERIAL if path.is_dir() else path
    try:
        text = bounded_text(file)
    except (OSError, UnicodeDecodeError) as error:
        raise LogError(f"{file}: cannot be read: {getattr(error, 'strerror', None) or error}") from error
    for program in FORMATS:
        if _has_mark(text, _PROGRAM_MARKS[program]):
            try:
                return _material_of_card(text, program)
            except (ValueError, KeyError, IndexError, StopIteration) as error:
                raise LogError(f"{file}: is not a whole card of {program}: {error!r}") from error
    return _material_of_fit(file, text, law)


def _has_mark(text: str, mark: str) -> bool:
    """Return True if a card has a keyword, in capitals or as the mark is written."""
    return mark in text.upper() or mark in text


def _material_of_card(text: str, program: Program) -> PronySeries | HyperelasticSolid:
    """Return the series or the solid of a program's card."""
    if any(_has_mark(text, mark) for mark in _SERIES_MARKS):
        return FORMATS[program].series(text)
    return HYPERELASTIC_CARDS[program].solid(text)


def _material_of_fit(path: Path, text: str, law: str | None) -> PronySeries | HyperelasticSolid:
    """Return the stated law of ``material.json``, or the best that a card can hold; raises UserError."""
    try:
        document = json_document(text)
        laws: dict[str, dict[str, Any]] = {table["law"]: table for table in document["laws"]}
        poisson = float(document["poisson"])
    except (ValueError, KeyError, TypeError) as error:
        raise LogError(f"{path}: is not a material.json of `palpate material fit`: {error}") from error
    if law is not None and law not in laws:
        raise ConfigurationError(f"--law: {path} has no law {law!r}{suggest(law, laws)}")
    name = law
    if name is None:
        # The laws are sorted, the best first.
        name = next((candidate for candidate in laws if candidate in SERIES or energy_of(candidate)), next(iter(laws)))
    table = laws[name]
    if energy_of(table["law"]) is None:
        return series_of_law(table, poisson)
    values = tuple(float(parameter["value"]) for parameter in table["parameters"].values())
    return HyperelasticSolid(table["law"], values, tuple(law_remarks(table, "incompressible")))


def _numbers(series: PronySeries) -> list[float]:
    """Return all numbers of a series: G_inf, then G_k and tau_k of each arm."""
    return [series.lasting, *(number for arm in series.arms for number in arm)]


def demand_same(written: Sequence[float], read: Sequence[float], program: str) -> None:
    """Raise RuntimeError, a fault of ours, where a card that is read back has other numbers than those written."""
    largest = max(map(abs, written))
    if len(written) != len(read) or any(
        abs(number - number_read) > _TOLERANCE * max(largest, abs(number))
        for number, number_read in zip(written, read, strict=True)
    ):
        raise RuntimeError(f"the card of {program} reads back as {read}, not {written}")
