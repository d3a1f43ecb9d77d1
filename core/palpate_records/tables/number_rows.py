"""The rows of numbers of a table, found in its first lines."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from palpate import LogError

from palpate_records.tables.cells import POINTS, has_decimal_comma
from palpate_records.tables.dialect import Dialect

ENOUGH_ROWS = 50  # that are certainly those of the table, so that more lines do not change it
MIN_ROWS = 3  # fewer are numbers by chance: results of a test above its readings


@dataclass(frozen=True)
class RowBlock:
    """Rows of numbers, one below the other."""

    begin: int  # line of the first, counted from 0
    rows: int
    width: int  # cells of a row
    numbers: int  # cells of a row that are numbers

    @property
    def is_certain(self) -> bool:
        """True if these rows are the table, however it goes on."""
        return self.rows >= ENOUGH_ROWS and self.numbers >= 2


def is_header(cells: Sequence[str], dialect: Dialect) -> bool:
    """Return True for cells that can be names or units: two texts at least, and no number."""
    filled = [cell for cell in cells if cell.strip()]
    return len(filled) >= 2 and not any(map(dialect.is_value, filled))


def block_of_rows(rows: Sequence[Sequence[str]], skipped: Collection[int], dialect: Dialect) -> RowBlock | None:
    """Return the longest block of rows of numbers, with what belongs to it above; None without one.

    What stands above a line that does not fit is not left out.
    """
    blocks = _blocks(rows, skipped, dialect)
    if not blocks:
        return None
    longest = max(blocks, key=lambda block: (block.numbers >= 2, block.rows))
    first = _first_part(longest, blocks, rows, dialect)
    begin = first.begin
    # A row of empty cells is one of readings that are missing.
    while begin and begin - 1 not in skipped and len(rows[begin - 1]) == first.width > 1 and not any(rows[begin - 1]):
        begin -= 1
    return replace(first, begin=begin)


def _blocks(rows: Sequence[Sequence[str]], skipped: Collection[int], dialect: Dialect) -> list[RowBlock]:
    """Return the blocks of rows with equally many cells, up to the first that is certain."""
    blocks: list[RowBlock] = []
    follows_row = False
    for i, cells in enumerate(rows):
        if i in skipped:
            continue
        numbers = sum(map(dialect.is_value, cells))
        if numbers and follows_row and blocks[-1].width == len(cells):
            block = blocks[-1]
            blocks[-1] = RowBlock(block.begin, block.rows + 1, block.width, max(block.numbers, numbers))
        elif numbers:
            blocks.append(RowBlock(i, 1, len(cells), numbers))
        follows_row = numbers > 0
        if blocks and blocks[-1].is_certain:
            break
    return blocks


def _first_part(
    longest: RowBlock, blocks: Sequence[RowBlock], rows: Sequence[Sequence[str]], dialect: Dialect
) -> RowBlock:
    """Return the block above the longest that belongs to the same table, else the longest itself."""
    for block in blocks:
        is_alike = block.width == longest.width and block.numbers >= longest.numbers
        if block.begin >= longest.begin or not is_alike:
            continue
        between = rows[block.begin + block.rows : longest.begin]
        if block.rows >= MIN_ROWS or not any(is_header(cells, dialect) for cells in between):
            return block
    return longest


def refuse_numbers_above(
    path: Path, rows: Sequence[Sequence[str]], skipped: Collection[int], block: RowBlock | None, dialect: Dialect
) -> None:
    """Raise LogError for lines above the rows of numbers that may be such rows, too."""
    above = [i for i in range(block.begin if block else len(rows)) if i not in skipped]
    for i in above if dialect.decimal == "." else ():
        comma = next((cell for cell in rows[i] if has_decimal_comma(cell)), None)
        if comma is not None and (block is None or len(rows[i]) == block.width):
            raise LogError(f"{path}:{i + 1}: its numbers have decimal commas ({comma.strip()[:20]!r}): {POINTS}")
    if block is not None and above and dialect.is_value(next(iter(rows[above[-1]]), "")):
        raise LogError(
            f"{path}:{above[-1] + 1}: the line has {len(rows[above[-1]])} cells, those below it {block.width}; "
            "header = LINE states where the names are"
        )
