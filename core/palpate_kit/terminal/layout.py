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

_LATEX_CHARACTERS = {c: f"\\{c}" for c in "&%$#_{}"} | {"~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
_LATEX_CHARACTERS |= {
    "\\": r"\textbackslash{}",
    "µ": r"$\mu$",
    "°": r"$^\circ$",
    "²": "$^2$",
    "·": r"$\cdot$",
    "±": r"$\pm$",
}
_NUMBER = r"[+-]?[\d.]+(?:e[+-]?\d+)?"
_QUANTITY = re.compile(rf"\(?(?P<value>{_NUMBER}) ± (?P<std>{_NUMBER}|\?)(?:\)(?P<power>e-?\d+))?")
_POWER = re.compile(r"\\textasciicircum\{\}(\d+)")
_layout: ContextVar[Layout] = ContextVar("layout", default="table")


def layout() -> Layout:
    """Return the form of tables by the command line."""
    return _layout.get()


def choose(context: typer.Context, form: Layout) -> Layout:
    """Set the form in which a command prints its tables, until it ends; the callback of an option."""
    token = _layout.set(form)
    context.call_on_close(lambda: _layout.reset(token))
    return form


def print_line(text: str) -> None:
    """Print a line of a screen; on standard error if tables are CSV or LaTeX, so that a pipe gets tables alone."""
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
    columns = [list(column.cells) for column in table.columns]
    rows = [[_plain(cell) for cell in row] for row in zip(*columns, strict=True)]
    title = _plain(table.title) if table.title else ""
    if form == "csv":
        return _csv(title, headings, rows)
    alignments = ["r" if column.justify == "right" else "l" for column in table.columns]
    return _latex(title, headings, rows, alignments)


def _csv(title: str, headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return the table as CSV: a value with an uncertainty becomes two columns."""
    pairs = [[_value_and_std(cell) for cell in row] for row in rows]
    has_std = [any(row[i][1] for row in pairs) for i in range(len(headings))]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    if title:
        text.write(f"# {title}\n")
    writer.writerow(_split_cells([(heading, _std_heading(heading)) for heading in headings], has_std))
    for row in pairs:
        writer.writerow(_split_cells(row, has_std))
    return text.getvalue()


def _split_cells(pairs: Sequence[tuple[str, str]], has_std: Sequence[bool]) -> list[str]:
    """Return the cells of pairs: both texts of a column with uncertainties, else the first."""
    cells: list[str] = []
    for (value, std), is_split in zip(pairs, has_std, strict=True):
        cells += (value, std) if is_split else (value,)
    return cells


def _value_and_std(cell: str) -> tuple[str, str]:
    """Return value and uncertainty of a cell that holds nothing else; any other text whole.

    >>> _value_and_std("112.8 ± 1.8"), _value_and_std("(6.7 ± 3.4)e6"), _value_and_std("5 ± ?")
    (('112.8', '1.8'), ('6.7e6', '3.4e6'), ('5', '?'))
    >>> _value_and_std("E 112.8 ± 1.8 kPa"), _value_and_std("0 (fixed)")
    (('E 112.8 ± 1.8 kPa', ''), ('0', ''))
    """
    match = _QUANTITY.fullmatch(cell)
    if match is None:
        return cell.removesuffix(FIXED), ""
    power = match["power"] or ""
    return match["value"] + power, match["std"] + power


def _std_heading(heading: str) -> str:
    """Return the heading of a column of uncertainties.

    >>> _std_heading("elasticity [kPa]"), _std_heading("mean")
    ('u(elasticity) [kPa]', 'u(mean)')
    """
    name, bracket, unit = heading.partition(" [")
    return f"u({name}){bracket}{unit}"


def _latex(title: str, headings: Sequence[str], rows: Sequence[Sequence[str]], alignments: Sequence[str]) -> str:
    """Return the table as a tabular of LaTeX with the rules of booktabs; its first line is a comment with the title."""
    lines = [f"% {title}"] if title else []
    lines += [rf"\begin{{tabular}}{{{' '.join(alignments)}}}", r"\toprule"]
    lines += [" & ".join(map(latex_text, headings)) + r" \\", r"\midrule"]
    lines += [" & ".join(map(latex_text, row)) + r" \\" for row in rows]
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"]) + "\n"


def latex_text(text: str) -> str:
    """Return a text with the characters that have a meaning in LaTeX escaped.

    >>> latex_text("5 ± 1 %")
    '5 $\\\\pm$ 1 \\\\%'
    >>> latex_text("N^2")
    'N$^2$'
    """
    escaped = "".join(_LATEX_CHARACTERS.get(character, character) for character in text)
    return _POWER.sub(r"$^\1$", escaped)


def _heading(header: Any) -> str:
    """Return a heading in one line, its unit in brackets.

    >>> _heading("viscosity\\nPa s"), _heading("auto-\\ncorrelation")
    ('viscosity [Pa s]', 'auto- correlation')
    """
    *name_lines, last_line = str(getattr(header, "plain", header)).split("\n")
    if name_lines and is_unit(last_line):
        return f"{_plain(' '.join(name_lines))} [{last_line}]"
    return _plain(header)


def _plain(cell: Any) -> str:
    """Return the text of a cell in one line, without its style."""
    return " ".join(str(getattr(cell, "plain", cell)).split())
