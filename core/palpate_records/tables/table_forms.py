"""The forms of tables, cached by the lines above their numbers: the files of a folder mostly have the same."""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass

from palpate_records.tables.csv_layout import TableLayout
from palpate_records.tables.dialect import Dialect
from palpate_records.tables.number_rows import ENOUGH_ROWS
from palpate_records.tables.plain_numbers import plain_numbers

_MAX_FORMS = 64  # in the cache, some kB each: a choice
# A mark that no thousands have: behind a leading zero or four digits, or not before exactly three.
_FRACTION = {mark: re.compile(rf"(?<!\d)0[{mark}]|\d{{4}}[{mark}]|[{mark}](?!\d{{3}}(?!\d))") for mark in ".,"}


@dataclass(frozen=True)
class TableForm:
    """The lines above the numbers of a table, with the dialect and layout that were found with them."""

    head: tuple[str, ...]
    dialect: Dialect
    layout: TableLayout

    def is_of(self, lines: Sequence[str]) -> bool:
        """Return True if the first lines of a file can have no other dialect and layout.

        The head is the same, and enough rows of numbers in this dialect follow, each with a fraction: in any other
        dialect these have fewer numbers in a row, or more text (0620).
        """
        count = len(self.head)
        rows = lines[count:]
        if len(rows) < max(count, ENOUGH_ROWS) or count > ENOUGH_ROWS or self.layout.width <= 1:
            return False
        if tuple(lines[:count]) != self.head or not all(map(_FRACTION[self.dialect.decimal].search, rows)):
            return False
        return plain_numbers("".join(rows), self.dialect, self.layout.width) is not None


_forms: dict[Hashable, TableForm] = {}  # of this process, by their stated keys and first line


def table_form(
    lines: Sequence[str], stated: Hashable, look: Callable[[], tuple[Dialect, TableLayout]]
) -> tuple[Dialect, TableLayout]:
    """Return the dialect and layout of a file by its first lines: of a form in the cache, else those from `look`.

    A form is the lines above the numbers, which files of one instrument share. The results and errors of `look` may
    depend on the lines and on the `stated` keys alone.
    """
    key = stated, *lines[:1]
    form = _forms.get(key)
    if form is not None and form.is_of(lines):
        return form.dialect, form.layout
    dialect, layout = look()
    form = TableForm(tuple(lines[: layout.begin]), dialect, layout)
    if form.head and form.is_of(lines):
        if len(_forms) >= _MAX_FORMS:
            _forms.clear()
        _forms[key] = form
    return dialect, layout
