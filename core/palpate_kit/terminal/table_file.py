"""A table of numbers and texts as a file: CSV, Parquet or a workbook, by its name; the same table is the same file."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO, Any
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

from palpate import ConfigurationError
from palpate_engine import whole_file

Column = Sequence[str] | Sequence[float | None]  # texts, or numbers, None for an unknown one
SUFFIXES = (".csv", ".parquet", ".xlsx")
_MAX_ROWS = 1 << 20  # of a sheet, by the format (ECMA-376)
_MAX_CHARACTERS = 32_767  # of a cell, by the format
_ILLEGAL = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f]")  # control characters that XML excludes
_DATED = re.compile(rb"(<dcterms:(?:created|modified)[^>]*>)[^<]*")


def demand_suffix(path: Path, option: str) -> None:
    """Raise ConfigurationError for a name that no table can have."""
    if path.suffix.lower() not in SUFFIXES:
        raise ConfigurationError(f"{option} {path}: a table's name ends in {', '.join(SUFFIXES)}")


def write_table(path: Path, columns: Mapping[str, Column]) -> None:
    """Write columns of one length; raises OutputError, and ConfigurationError without the library or for its limits."""
    with whole_file(path, binary=True) as file:
        {".csv": _write_csv, ".parquet": _write_parquet, ".xlsx": _write_workbook}[path.suffix.lower()](
            file, path, columns
        )


def _write_csv(file: IO[bytes], path: Path, columns: Mapping[str, Column]) -> None:
    """Write the columns as CSV; an unknown number is an empty cell."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(["" if cell is None else cell for cell in row] for row in zip(*columns.values(), strict=True))
    file.write(text.getvalue().encode())


def _write_parquet(file: IO[bytes], path: Path, columns: Mapping[str, Column]) -> None:
    """Write the columns as Parquet, texts and numbers; raises ConfigurationError without pyarrow."""
    try:
        import pyarrow  # type: ignore[import-not-found,import-untyped,unused-ignore]
        import pyarrow.parquet  # type: ignore[import-not-found,import-untyped,unused-ignore]
    except ImportError as error:
        raise ConfigurationError(f'{path}: needs pyarrow; pip install "palpate[parquet]"') from error
    types = {name: pyarrow.string() if _is_text(cells) else pyarrow.float64() for name, cells in columns.items()}
    arrays = [pyarrow.array(cells, types[name]) for name, cells in columns.items()]
    pyarrow.parquet.write_table(pyarrow.table(arrays, names=list(columns)), file)


def _write_workbook(file: IO[bytes], path: Path, columns: Mapping[str, Column]) -> None:
    """Write a workbook with one sheet; its dates are replaced, so that the same table is the same file.

    Raises ConfigurationError without openpyxl, and for more rows than a sheet holds.
    """
    try:
        from openpyxl import Workbook
        from openpyxl.cell import WriteOnlyCell
    except ImportError as error:
        raise ConfigurationError(f'{path}: needs openpyxl; pip install "palpate[excel]"') from error
    count = max((len(cells) for cells in columns.values()), default=0)
    if count >= _MAX_ROWS:
        raise ConfigurationError(
            f"{path}: a sheet holds {_MAX_ROWS - 1} rows, and there are {count}: write .parquet or .csv"
        )
    book = Workbook(write_only=True)
    sheet: Any = book.create_sheet("values")
    sheet.freeze_panes = "A2"

    def text(cell: str) -> Any:
        """Return a cell of type text, so that one that begins with "=" is not a formula."""
        text_cell: Any = WriteOnlyCell(sheet, _ILLEGAL.sub("", cell)[:_MAX_CHARACTERS])
        text_cell.data_type = "s"
        return text_cell

    for row in (tuple(columns), *zip(*columns.values(), strict=True)):
        sheet.append([text(cell) if isinstance(cell, str) else cell for cell in row])
    # openpyxl writes its time of creation into the workbook, and zipfile that of each entry: both become 1980.
    dated = io.BytesIO()
    book.save(dated)
    with ZipFile(dated) as dated_archive, ZipFile(file, "w", ZIP_DEFLATED) as archive:
        for name in dated_archive.namelist():
            entry = ZipInfo(name)
            entry.compress_type = ZIP_DEFLATED
            archive.writestr(entry, _DATED.sub(rb"\g<1>1980-01-01T00:00:00Z", dated_archive.read(name)))


def _is_text(cells: Column) -> bool:
    return any(isinstance(cell, str) for cell in cells)
