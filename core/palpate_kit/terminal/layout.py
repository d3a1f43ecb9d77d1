"""Form in which tables are printed: for a terminal, as CSV, or as LaTeX."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator, Sequence
from contextvars import ContextVar
from typing import Any, Literal

import typer
from palpate import is_unit

from palpate_kit.terminal.quantities import FIXED

Layout = Literal["table", "csv", "latex"]

_ESCAPED = {c: f"\\{c}" for c in "&%$#_{}"} | {"~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
_ESCAPED |= {"\\": r"\textbackslash{}", "µ": r"$\mu$", "°": r"$^\circ$", "²": "$^2$", "·": r"$\cdot$", "±": r"$\pm$"}
_NUMBER = r"[+-]?[\d.]+(?:e[+-]?\d+)?"
_QUANTITY = re.compile(rf"\(?(?P<value>{_NUMBER}) ± (?P<std>{_NUMBER}|\?)(?:\)(?P<power>e-?\d+))?")
_RAISED = re.compile(r"\\textasciicircum\{\}(\d+)")
_chosen: ContextVar[Layout] = ContextVar("layout", default="table")


def layout() -> Layout:
    """Return the form that the command line asks for."""
    return _chosen.get()


def choose(context: typer.Context, form: Layout) -> Layout:
    """Print the tables of this command in another form."""
    token = _chosen.set(form)
    context.call_on_close(lambda: _chosen.reset(token))
    return form


def print_line(text: str) -> None:
    """Print a line of a screen; next to tables in another format on standard error, so that only they are piped on."""
    typer.echo(text, err=layout() != "table")


def tables_in(shown: Any) -> Iterator[Any]:
    """Yield the tables among what is printed, in their order."""
    from rich.console import Group
    from rich.table import Table

    if isinstance(shown, Table):
        yield shown
    elif isinstance(shown, Group):
        for item in shown.renderables:
            yield from tables_in(item)


def text_of(table: Any, form: Layout) -> str:
    """Return a table of a terminal as CSV, its first line a comment with the title, or as LaTeX (booktabs)."""
    headings = [_heading(column.header) for column in table.columns]
    rows = [[_plain(cell) for cell in row] for row in zip(*(list(c.cells) for c in table.columns), strict=True)]
    title = _plain(table.title) if table.title else ""
    if form == "csv":
        return _csv(title, headings, rows)
    return _latex(title, headings, rows, ["r" if column.justify == "right" else "l" for column in table.columns])


def _csv(title: str, headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return the table as CSV: a value with an uncertainty becomes two columns."""
    pairs = [[_pair(cell) for cell in row] for row in rows]
    double = [any(row[i][1] for row in pairs) for i in range(len(headings))]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    if title:
        text.write(f"# {title}\n")
    writer.writerow(_split([(heading, _uncertainty(heading)) for heading in headings], double))
    for row in pairs:
        writer.writerow(_split(row, double))
    return text.getvalue()


def _split(pairs: Sequence[tuple[str, str]], double: Sequence[bool]) -> list[str]:
    """Return the cells of pairs: both texts of a column that is double, else the first."""
    cells: list[str] = []
    for (value, std), is_double in zip(pairs, double, strict=True):
        cells += (value, std) if is_double else (value,)
    return cells


def _pair(cell: str) -> tuple[str, str]:
    """Return value and uncertainty of a cell that holds nothing else; any other text whole.

    >>> _pair("112.8 ± 1.8"), _pair("(6.7 ± 3.4)e6"), _pair("5 ± ?"), _pair("E 112.8 ± 1.8 kPa"), _pair("0 (fixed)")
    (('112.8', '1.8'), ('6.7e6', '3.4e6'), ('5', '?'), ('E 112.8 ± 1.8 kPa', ''), ('0', ''))
    """
    match = _QUANTITY.fullmatch(cell)
    if match is None:
        return cell.removesuffix(FIXED), ""
    power = match["power"] or ""
    return match["value"] + power, match["std"] + power


def _uncertainty(heading: str) -> str:
    """Return the heading of a column of uncertainties.

    >>> _uncertainty("elasticity [kPa]"), _uncertainty("mean")
    ('u(elasticity) [kPa]', 'u(mean)')
    """
    name, bracket, unit = heading.partition(" [")
    return f"u({name}){bracket}{unit}"


def _latex(title: str, headings: Sequence[str], rows: Sequence[Sequence[str]], sides: Sequence[str]) -> str:
    lines = [f"% {title}"] if title else []
    lines += [rf"\begin{{tabular}}{{{' '.join(sides)}}}", r"\toprule"]
    lines += [" & ".join(map(latex_text, headings)) + r" \\", r"\midrule"]
    lines += [" & ".join(map(latex_text, row)) + r" \\" for row in rows]
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"]) + "\n"


def latex_text(text: str) -> str:
    """Return a text as LaTeX has it.

    >>> latex_text("5 ± 1 %")
    '5 $\\\\pm$ 1 \\\\%'
    >>> latex_text("N^2")
    'N$^2$'
    """
    escaped = "".join(_ESCAPED.get(character, character) for character in text)
    return _RAISED.sub(r"$^\1$", escaped)


def _heading(header: Any) -> str:
    """Return a heading in one line, its unit in brackets.

    >>> _heading("viscosity\\nPa s"), _heading("auto-\\ncorrelation")
    ('viscosity [Pa s]', 'auto- correlation')
    """
    *above, last = str(getattr(header, "plain", header)).split("\n")
    if above and is_unit(last):
        return f"{_plain(' '.join(above))} [{last}]"
    return _plain(header)


def _plain(cell: Any) -> str:
    return " ".join(str(getattr(cell, "plain", cell)).split())
