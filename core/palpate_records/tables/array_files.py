"""Files of arrays (NumPy, MATLAB, HDF5, Arrow, JSON) as tables; nothing that they hold is executed."""

from __future__ import annotations

import json
import math
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import IO, Any

import numpy as np
from palpate import LogError, printable, suggest

from palpate_records.decompression import largest
from palpate_records.tables.array_table import Array, ArrayTable, demand_readable_size, tables_of

Named = Iterator[tuple[Sequence[str], Any]]  # a path of names, and an array
_MAX_DEPTH = 6  # of groups within groups
_MAX_BYTES = 1 << 28  # of a text of JSON
_COMPRESSED = 15  # the type of a compressed element of a .mat file
_PIECE = 1 << 20  # [bytes] that are unpacked at once
_MAT_HEAD = 128  # [bytes] before the first element


def array_text(path: Path, table: str | None) -> str:
    """Return a table of a file as text, that with most columns if none is named; raises LogError."""
    tables = array_tables(path)
    if table is None:
        return tables[0].text()
    by_name = {candidate.name: candidate for candidate in tables}
    if table not in by_name:
        raise LogError(f"{path}: no table {table!r}{suggest(table, list(by_name))}")
    return by_name[table].text()


def array_tables(path: Path) -> tuple[ArrayTable, ...]:
    """Return the tables of a file; raises LogError where it has none or cannot be read."""
    status = path.stat()
    return _tables(path, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=1)
def _tables(path: Path, changed: int, size: int) -> tuple[ArrayTable, ...]:
    suffix = path.suffix.lower()
    try:
        tables = tables_of(_READERS[suffix](path), path.stem)
    except ImportError as error:
        library = (error.name or "").partition(".")[0]
        raise LogError(f"{path}: reading {suffix} files needs {library}: pip install {library}") from error
    except Exception as error:  # whatever unpacking and parsing raise on a damaged file
        reason = printable(" ".join(str(error).split()))[:200]
        raise LogError(f"{path}: cannot be read as {suffix}: {reason or type(error).__name__}") from error
    if not tables:
        raise LogError(f"{path}: the file contains no columns of numbers: no two arrays of one length")
    return tuple(tables)


def _npy(path: Path) -> Named:
    with path.open("rb") as file:
        _demand_numbers(file, path.stat().st_size)
        file.seek(0)
        yield ("",), np.load(file, allow_pickle=False)


def _npz(path: Path) -> Named:
    with zipfile.ZipFile(path) as archive:
        if sum(member.file_size for member in archive.infolist()) > largest(path.stat().st_size):
            raise ValueError("it unpacks to more than a file of its size does")
        for member in archive.infolist():
            with archive.open(member) as file:
                _demand_numbers(file, member.file_size)
            with archive.open(member) as file:
                name = member.filename.removesuffix(".npy")
                yield name.split(":"), np.lib.format.read_array(file, allow_pickle=False)


def _demand_numbers(file: IO[bytes], size: int) -> None:
    """Raise ValueError for an array of Python objects, or one that is larger than its file says."""
    version = np.lib.format.read_magic(file)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read(file)
    if dtype.hasobject:
        raise ValueError(
            "it holds Python objects, which are never read since they may run code; save arrays of numbers"
        )
    demand_readable_size(math.prod(shape) * max(len(dtype.names or ()), 1))
    if math.prod(shape) * dtype.itemsize > size - file.tell():
        raise ValueError(f"its array of shape {shape} is longer than the file: it was cut")


def _mat(path: Path) -> Named:
    from scipy.io import loadmat

    with path.open("rb") as file:
        head = file.read(_MAT_HEAD)
        if head.startswith(b"MATLAB 7.3") or head[:8] == b"\x89HDF\r\n\x1a\n":
            raise ValueError("it is of version 7.3: save it with -v7 in MATLAB")
        _demand_sizes(file, path.stat().st_size)
    for name, value in loadmat(path, squeeze_me=True, chars_as_strings=True).items():
        if not name.startswith("__"):
            yield from _of_struct((name,), value)


def _demand_sizes(file: IO[bytes], size: int) -> None:
    """Raise ValueError where the elements of a .mat file unpack to more than a file of its size does."""
    room = largest(size)
    while len(tag := file.read(8)) == 8:
        element_type, length = np.frombuffer(tag, "<u4").tolist()
        if element_type != _COMPRESSED:
            file.seek(length, 1)
            continue
        unpacker, packed = zlib.decompressobj(), file.read(length)
        while packed and not unpacker.eof:
            room -= len(unpacker.decompress(packed, _PIECE))
            packed = unpacker.unconsumed_tail
            if room < 0:
                raise ValueError("it unpacks to more than a file of its size does")


def _of_struct(path: tuple[str, ...], value: Any) -> Named:
    """Yield the fields of a struct, or an array."""
    array = np.asarray(value)
    if array.dtype.names is None or array.size > 1 or len(path) > _MAX_DEPTH:
        yield path, array
        return
    for field in array.dtype.names:
        yield from _of_struct((*path, field), array.reshape(-1)[0][field])


def _hdf5(path: Path) -> Named:
    import h5py  # type: ignore[import-not-found,import-untyped,unused-ignore]

    def visit(group: Any, above: tuple[str, ...]) -> Named:
        for name in group if len(above) < _MAX_DEPTH else ():
            # Links may lead into other files; what a dataset has in other files is not read either.
            if not isinstance(group.get(name, getlink=True), h5py.HardLink):
                continue
            member = group[name]
            if isinstance(member, h5py.Group):
                yield from visit(member, (*above, name))
            elif not member.external and not member.is_virtual and member.dtype.kind in "biufSV":
                demand_readable_size(member.size * max(len(member.dtype.names or ()), 1))
                yield from _of_dataset((*above, name), member)

    with h5py.File(path, "r") as file:
        yield from visit(file, ())


def _of_dataset(path: tuple[str, ...], dataset: Any) -> Named:
    """Yield a dataset, whose attributes may state its unit, or the names of the columns of a matrix."""
    values = dataset[()]
    attributes = {str(key).lower(): value for key, value in dataset.attrs.items()}
    unit = next((_word(attributes[key]) for key in ("unit", "units") if key in attributes), "")
    names = next((attributes[key] for key in ("columns", "column_names", "names") if key in attributes), ())
    if np.ndim(values) == 2 and np.size(names) == values.shape[1]:
        for k, name in enumerate(np.ravel(names).tolist()):
            yield (*path[:-1], _word(name)), values[:, k]
    else:
        yield (*path[:-1], f"{path[-1]} [{unit}]" if unit else path[-1]), values


def _word(value: Any) -> str:
    value = np.ravel(value).tolist()[0] if np.size(value) == 1 else value
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)


def _parquet(path: Path) -> Named:
    import pyarrow.parquet as parquet  # type: ignore[import-not-found,import-untyped,unused-ignore]

    file = parquet.ParquetFile(path)
    demand_readable_size(file.metadata.num_rows * file.metadata.num_columns)
    yield from _of_arrow(file.read())


def _feather(path: Path) -> Named:
    import pyarrow.feather as feather  # type: ignore[import-not-found,import-untyped,unused-ignore]

    yield from _of_arrow(feather.read_table(path, memory_map=False))


def _of_arrow(table: Any) -> Named:
    demand_readable_size(table.num_rows * table.num_columns)
    for name, column in zip(table.column_names, table.columns, strict=True):
        array: Array = column.to_numpy()
        yield (name,), array.astype(str) if array.dtype.kind == "O" else array


def _json(path: Path) -> Named:
    if path.stat().st_size > _MAX_BYTES:
        raise ValueError(f"it has more than {_MAX_BYTES >> 20} MiB")
    document = _document(path.read_text(encoding="utf-8-sig"))
    if isinstance(document, Mapping) and {"schema", "palpate"} <= document.keys():
        raise ValueError("it is a result of palpate, and not a table")
    yield from _of_document((), document)


def _document(text: str) -> Any:
    """Return a document of JSON; of one in each line, a list."""
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        lines = [line for line in text.splitlines() if line.strip()]
        if len(lines) < 2:
            raise
        with suppress(json.JSONDecodeError):
            return [json.loads(line) for line in lines]
        raise


def _of_document(path: tuple[str, ...], value: Any) -> Named:
    """Yield the columns of a document: lists by name, rows of objects, or names with rows of lists."""
    if len(path) > _MAX_DEPTH:
        return
    if isinstance(value, Mapping):
        if isinstance(value.get("columns"), list) and isinstance(value.get("data"), list):  # pandas, orient="split"
            yield from zip(((*path, str(name)) for name in value["columns"]), zip(*value["data"], strict=True))
        elif len(value) > _MAX_DEPTH and all(
            str(key).isdigit() for key in value
        ):  # a column by the numbers of its rows
            yield path, _column(value.values())
        elif path and (numbers := _numbers_of_unit(value)) is not None:
            yield (*path[:-1], f"{path[-1]} [{value['unit']}]"), _column(numbers)
        else:
            for key, inner in value.items():
                yield from _of_document((*path, str(key)), inner)
    elif isinstance(value, list) and value and all(isinstance(row, Mapping) for row in value):
        for key in value[0]:
            yield from _of_document((*path, str(key)), [row.get(key) for row in value])
    elif isinstance(value, list):
        with suppress(ValueError, TypeError):  # lists of several lengths, or of anything else than numbers
            yield path or ("",), _column(value)
    elif isinstance(value, int | float | str):
        yield path or ("",), value


def _numbers_of_unit(value: Mapping[str, Any]) -> list[Any] | None:
    """Return the one list of an object that states its unit, as {"unit": "mN", "data": [...]}; None for any other."""
    lists = [inner for inner in value.values() if isinstance(inner, list)]
    is_one = isinstance(value.get("unit"), str) and len(lists) == 1
    return lists[0] if is_one and all(isinstance(cell, int | float | None) for cell in lists[0]) else None


def _column(values: Iterable[Any]) -> Array:
    """Return numbers, NaN where there is null, or texts."""
    cells = list(values)
    if any(isinstance(cell, str) for cell in cells):
        return np.array(["" if cell is None else str(cell) for cell in cells])
    return np.array([[math.nan if x is None else x for x in cell] if isinstance(cell, list) else
                     math.nan if cell is None else cell for cell in cells], dtype=np.float64)  # fmt: skip


_READERS: Mapping[str, Callable[[Path], Iterable[tuple[Sequence[str], Any]]]] = {
    ".npy": _npy,
    ".npz": _npz,
    ".mat": _mat,
    ".h5": _hdf5,
    ".hdf5": _hdf5,
    ".parquet": _parquet,
    ".feather": _feather,
    ".json": _json,
    ".jsonl": _json,
    ".ndjson": _json,
}
ARRAY_FILES = tuple(_READERS)
