"""The rows of numbers of a table, found in its first lines."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from palpate import LogError

from palpate_records.tables.cells import POINTS, has_decimal_comma
from palpate_records.tables.dialect import Dialect

# Choices.
ENOUGH_ROWS = 50  # that are certainly those of the table, so that more lines do not change it
MIN_ROWS = 3  # fewer are numbers by chance: results of a test above its readings
_MAX_EXAMPLE = 20  # characters of a cell in a message


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
    """Return the longest block of rows of numbers, from the first block above it on that is of the same table.

    `rows` are the cells of the lines, `skipped` the numbers of empty lines and comments. None without rows of numbers.
    A line that does not fit between blocks does not separate them.
    """
    blocks = _blocks(rows, skipped, dialect)
    if not blocks:
        return None
    # A block with several numbers in a row goes before any list of single numbers.
    longest = max(blocks, key=lambda block: (block.numbers >= 2, block.rows))
    first = _first_part(longest, blocks, rows, dialect)
    begin = first.begin
    # A row of empty cells has missing readings.
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
        number_count = sum(map(dialect.is_value, cells))
        if number_count and follows_row and blocks[-1].width == len(cells):
            block = blocks[-1]
            blocks[-1] = RowBlock(block.begin, block.rows + 1, block.width, max(block.numbers, number_count))
        elif number_count:
            blocks.append(RowBlock(i, 1, len(cells), number_count))
        follows_row = number_count > 0
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
        rows_between = rows[block.begin + block.rows : longest.begin]
        if block.rows >= MIN_ROWS or not any(is_header(cells, dialect) for cells in rows_between):
            return block
    return longest


def refuse_numbers_above(
    path: Path, rows: Sequence[Sequence[str]], skipped: Collection[int], block: RowBlock | None, dialect: Dialect
) -> None:
    """Raise LogError for lines above the rows of numbers that may be such rows, too.

    `block` is where the rows of numbers are (None: nowhere), `skipped` are the numbers of empty lines and comments.
    """
    lines_above = [i for i in range(block.begin if block else len(rows)) if i not in skipped]
    # Rows with decimal commas, which are not numbers in this dialect.
    if dialect.decimal == ".":
        for line in lines_above:
            cell = next((cell for cell in rows[line] if has_decimal_comma(cell)), None)
            if cell is not None and (block is None or len(rows[line]) == block.width):
                example = cell.strip()[:_MAX_EXAMPLE]
                raise LogError(f"{path}:{line + 1}: its numbers have decimal commas ({example!r}): {POINTS}")
    # A row of another width directly above the first.
    if block is not None and lines_above:
        last_line = lines_above[-1]
        if dialect.is_value(next(iter(rows[last_line]), "")):
            raise LogError(
                f"{path}:{last_line + 1}: the line has {len(rows[last_line])} cells, those below it {block.width}; "
                "header = LINE states where the names are"
            )
