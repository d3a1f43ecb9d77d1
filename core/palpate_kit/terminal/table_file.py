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

Column = Sequence[str] | Sequence[float | None]  # texts, or numbers of which some are not known
SUFFIXES = (".csv", ".parquet", ".xlsx")
_MOST = 1 << 20  # rows of a sheet
_LONGEST = 32_767  # characters of a cell
_ILLEGAL = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f]")
_DATED = re.compile(rb"(<dcterms:(?:created|modified)[^>]*>)[^<]*")


def demand_suffix(path: Path, option: str) -> None:
    """Raise ConfigurationError for a name that no table can have."""
    if path.suffix.lower() not in SUFFIXES:
        raise ConfigurationError(f"{option} {path}: a table's name ends in {', '.join(SUFFIXES)}")


def write_table(path: Path, columns: Mapping[str, Column]) -> None:
    """Write columns of one length; raises OutputError, and ConfigurationError without the library or for its limits."""
    with whole_file(path, binary=True) as file:
        {".csv": _csv, ".parquet": _parquet, ".xlsx": _workbook}[path.suffix.lower()](file, path, columns)


def _csv(file: IO[bytes], path: Path, columns: Mapping[str, Column]) -> None:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(["" if cell is None else cell for cell in row] for row in zip(*columns.values(), strict=True))
    file.write(text.getvalue().encode())


def _parquet(file: IO[bytes], path: Path, columns: Mapping[str, Column]) -> None:
    try:
        import pyarrow  # type: ignore[import-not-found,import-untyped,unused-ignore]
        import pyarrow.parquet  # type: ignore[import-not-found,import-untyped,unused-ignore]
    except ImportError as error:
        raise ConfigurationError(f'{path}: needs pyarrow; pip install "palpate[parquet]"') from error
    kinds = {name: pyarrow.string() if _is_text(cells) else pyarrow.float64() for name, cells in columns.items()}
    arrays = [pyarrow.array(cells, kinds[name]) for name, cells in columns.items()]
    pyarrow.parquet.write_table(pyarrow.table(arrays, names=list(columns)), file)


def _workbook(file: IO[bytes], path: Path, columns: Mapping[str, Column]) -> None:
    try:
        from openpyxl import Workbook
        from openpyxl.cell import WriteOnlyCell
    except ImportError as error:
        raise ConfigurationError(f'{path}: needs openpyxl; pip install "palpate[excel]"') from error
    count = max((len(cells) for cells in columns.values()), default=0)
    if count >= _MOST:
        raise ConfigurationError(
            f"{path}: a sheet holds {_MOST - 1} rows, and there are {count}: write .parquet or .csv"
        )
    book = Workbook(write_only=True)
    sheet: Any = book.create_sheet("values")
    sheet.freeze_panes = "A2"

    def text(cell: str) -> Any:
        """Return a text, whatever it begins with: never a formula."""
        found: Any = WriteOnlyCell(sheet, _ILLEGAL.sub("", cell)[:_LONGEST])
        found.data_type = "s"
        return found

    for row in (tuple(columns), *zip(*columns.values(), strict=True)):
        sheet.append([text(cell) if isinstance(cell, str) else cell for cell in row])
    dated = io.BytesIO()
    book.save(dated)
    with ZipFile(dated) as before, ZipFile(file, "w", ZIP_DEFLATED) as archive:
        for name in before.namelist():
            entry = ZipInfo(name)  # of 1980
            entry.compress_type = ZIP_DEFLATED
            archive.writestr(entry, _DATED.sub(rb"\g<1>1980-01-01T00:00:00Z", before.read(name)))


def _is_text(cells: Column) -> bool:
    return any(isinstance(cell, str) for cell in cells)
