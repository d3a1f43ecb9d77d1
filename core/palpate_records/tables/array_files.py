"""Files of arrays (NumPy, MATLAB, HDF5, Arrow, JSON) as tables; no code in them is executed."""

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

NamedArrays = Iterator[tuple[Sequence[str], Any]]  # a path of names, and an array
# Choices.
_MAX_DEPTH = 6  # of groups within groups
_MAX_JSON_SIZE = 1 << 28  # [bytes]
_MAX_NUMBERED_FIELDS = 6  # of an object; one with more keys that are digits is a column by the numbers of its rows
_MAX_REASON = 200  # characters of a library's message that are shown
_PIECE_SIZE = 1 << 20  # [bytes] that are unpacked at once
# Of the format of .mat files, version 5 (MathWorks, MAT-File Format).
_COMPRESSED_TYPE = 15  # of an element
_MAT_HEAD_SIZE = 128  # [bytes] before the first element
_MAT_TAG_SIZE = 8  # [bytes] of type and length, before each element


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
    """Return the tables of a file, that with most columns first; raises LogError if it has none or cannot be read."""
    status = path.stat()
    return _read_tables(path, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=1)
def _read_tables(path: Path, changed: int, size: int) -> tuple[ArrayTable, ...]:
    """Return the tables of a file; its time of change [ns] and size [bytes] are only keys of the cache."""
    suffix = path.suffix.lower()
    try:
        tables = tables_of(_READERS[suffix](path), path.stem)
    except ImportError as error:
        library = (error.name or "").partition(".")[0]
        raise LogError(f"{path}: reading {suffix} files needs {library}: pip install {library}") from error
    except Exception as error:  # whatever unpacking and parsing raise on a damaged file
        reason = printable(" ".join(str(error).split()))[:_MAX_REASON]
        raise LogError(f"{path}: cannot be read as {suffix}: {reason or type(error).__name__}") from error
    if not tables:
        raise LogError(f"{path}: the file contains no columns of numbers: no two arrays of one length")
    return tuple(tables)


def _npy_arrays(path: Path) -> NamedArrays:
    """Yield the array of a .npy file."""
    with path.open("rb") as file:
        _demand_numbers(file, path.stat().st_size)
        file.seek(0)
        yield ("",), np.load(file, allow_pickle=False)


def _npz_arrays(path: Path) -> NamedArrays:
    """Yield the arrays of a .npz file; a colon in a name separates groups."""
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
    """Raise ValueError for an array of Python objects, or of more than the `size` [bytes] of its file."""
    version = np.lib.format.read_magic(file)
    read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read_header(file)
    if dtype.hasobject:
        raise ValueError(
            "it holds Python objects, which are never read since they may run code; save arrays of numbers"
        )
    demand_readable_size(math.prod(shape) * max(len(dtype.names or ()), 1))
    if math.prod(shape) * dtype.itemsize > size - file.tell():
        raise ValueError(f"its array of shape {shape} is longer than the file: it was cut")


def _mat_arrays(path: Path) -> NamedArrays:
    """Yield the variables of a .mat file up to version 7, and the fields of its structs."""
    from scipy.io import loadmat

    with path.open("rb") as file:
        head = file.read(_MAT_HEAD_SIZE)
        if head.startswith((b"MATLAB 7.3", b"\x89HDF\r\n\x1a\n")):
            raise ValueError("it is of version 7.3: save it with -v7 in MATLAB")
        _demand_packed_size(file, path.stat().st_size)
    for name, value in loadmat(path, squeeze_me=True, chars_as_strings=True).items():
        if not name.startswith("__"):
            yield from _struct_arrays((name,), value)


def _demand_packed_size(file: IO[bytes], size: int) -> None:
    """Raise ValueError if the elements of a .mat file unpack to more than a file of its `size` [bytes] does."""
    remaining = largest(size)
    while len(tag := file.read(_MAT_TAG_SIZE)) == _MAT_TAG_SIZE:
        element_type, length = np.frombuffer(tag, "<u4").tolist()
        if element_type != _COMPRESSED_TYPE:
            file.seek(length, 1)
            continue
        unpacker = zlib.decompressobj()
        packed = file.read(length)
        while packed and not unpacker.eof:
            remaining -= len(unpacker.decompress(packed, _PIECE_SIZE))
            packed = unpacker.unconsumed_tail
            if remaining < 0:
                raise ValueError("it unpacks to more than a file of its size does")


def _struct_arrays(path: tuple[str, ...], value: Any) -> NamedArrays:
    """Yield the fields of a struct, and anything else as an array."""
    array = np.asarray(value)
    is_struct = array.dtype.names is not None and array.size <= 1
    if not is_struct or len(path) > _MAX_DEPTH:
        yield path, array
        return
    for field in array.dtype.names or ():
        yield from _struct_arrays((*path, field), array.reshape(-1)[0][field])


def _hdf5_arrays(path: Path) -> NamedArrays:
    """Yield the datasets of an HDF5 file."""
    import h5py  # type: ignore[import-not-found,import-untyped,unused-ignore]

    def visit(group: Any, parents: tuple[str, ...]) -> NamedArrays:
        """Yield the datasets in a group and in the groups within it."""
        for name in group if len(parents) < _MAX_DEPTH else ():
            # Links may lead into other files, and datasets may lie in them: neither is followed.
            if not isinstance(group.get(name, getlink=True), h5py.HardLink):
                continue
            member = group[name]
            if isinstance(member, h5py.Group):
                yield from visit(member, (*parents, name))
            elif not member.external and not member.is_virtual and member.dtype.kind in "biufSV":
                demand_readable_size(member.size * max(len(member.dtype.names or ()), 1))
                yield from _dataset_arrays((*parents, name), member)

    with h5py.File(path, "r") as file:
        yield from visit(file, ())


def _dataset_arrays(path: tuple[str, ...], dataset: Any) -> NamedArrays:
    """Yield a dataset, whose attributes may state its unit, or the names of the columns of a matrix."""
    values = dataset[()]
    attributes = {str(key).lower(): value for key, value in dataset.attrs.items()}
    unit = next((_attribute_text(attributes[key]) for key in ("unit", "units") if key in attributes), "")
    names = next((attributes[key] for key in ("columns", "column_names", "names") if key in attributes), ())
    if np.ndim(values) == 2 and np.size(names) == values.shape[1]:
        for k, name in enumerate(np.ravel(names).tolist()):
            yield (*path[:-1], _attribute_text(name)), values[:, k]
    else:
        yield (*path[:-1], f"{path[-1]} [{unit}]" if unit else path[-1]), values


def _attribute_text(value: Any) -> str:
    """Return an attribute as text: bytes, or an array of one element."""
    value = np.ravel(value).tolist()[0] if np.size(value) == 1 else value
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)


def _parquet_arrays(path: Path) -> NamedArrays:
    """Yield the columns of a Parquet file."""
    import pyarrow.parquet as parquet  # type: ignore[import-not-found,import-untyped,unused-ignore]

    file = parquet.ParquetFile(path)
    demand_readable_size(file.metadata.num_rows * file.metadata.num_columns)
    yield from _arrow_arrays(file.read())


def _feather_arrays(path: Path) -> NamedArrays:
    """Yield the columns of a Feather file."""
    import pyarrow.feather as feather  # type: ignore[import-not-found,import-untyped,unused-ignore]

    yield from _arrow_arrays(feather.read_table(path, memory_map=False))


def _arrow_arrays(table: Any) -> NamedArrays:
    """Yield the columns of a table of Arrow; those of objects as text."""
    demand_readable_size(table.num_rows * table.num_columns)
    for name, column in zip(table.column_names, table.columns, strict=True):
        array: Array = column.to_numpy()
        yield (name,), array.astype(str) if array.dtype.kind == "O" else array


def _json_arrays(path: Path) -> NamedArrays:
    """Yield the columns of a document of JSON; raises ValueError for a result of palpate."""
    if path.stat().st_size > _MAX_JSON_SIZE:
        raise ValueError(f"it has more than {_MAX_JSON_SIZE >> 20} MiB")
    document = _parse_document(path.read_text(encoding="utf-8-sig"))
    if isinstance(document, Mapping) and {"schema", "palpate"} <= document.keys():
        raise ValueError("it is a result of palpate, and not a table")
    yield from _document_columns((), document)


def _parse_document(text: str) -> Any:
    """Return a document of JSON, or the list of the documents in its lines; raises json.JSONDecodeError."""
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        lines = [line for line in text.splitlines() if line.strip()]
        if len(lines) < 2:
            raise
        with suppress(json.JSONDecodeError):
            return [json.loads(line) for line in lines]
        raise  # the error of the whole text


def _document_columns(path: tuple[str, ...], value: Any) -> NamedArrays:
    """Yield the columns of a document: lists by name, rows of objects, or names with rows of lists."""
    if len(path) > _MAX_DEPTH:
        return
    if isinstance(value, Mapping):
        yield from _object_columns(path, value)
    elif isinstance(value, list) and value and all(isinstance(row, Mapping) for row in value):
        for key in value[0]:
            yield from _document_columns((*path, str(key)), [row.get(key) for row in value])
    elif isinstance(value, list):
        with suppress(ValueError, TypeError):  # lists of several lengths, or of anything else than numbers
            yield path or ("",), _column(value)
    elif isinstance(value, int | float | str):
        yield path or ("",), value


def _object_columns(path: tuple[str, ...], value: Mapping[str, Any]) -> NamedArrays:
    """Yield the columns of an object: of a table as pandas writes it, a column, or columns by name."""
    is_split_table = isinstance(value.get("columns"), list) and isinstance(value.get("data"), list)
    has_row_numbers = len(value) > _MAX_NUMBERED_FIELDS and all(str(key).isdigit() for key in value)
    if is_split_table:  # orient="split"
        yield from zip(((*path, str(name)) for name in value["columns"]), zip(*value["data"], strict=True))
    elif has_row_numbers:  # orient="columns": each column is an object by the numbers of its rows
        yield path, _column(value.values())
    elif path and (numbers := _numbers_of_unit(value)) is not None:
        yield (*path[:-1], f"{path[-1]} [{value['unit']}]"), _column(numbers)
    else:
        for key, inner_value in value.items():
            yield from _document_columns((*path, str(key)), inner_value)


def _numbers_of_unit(value: Mapping[str, Any]) -> list[Any] | None:
    """Return the one list of an object that states its unit, as {"unit": "mN", "data": [...]}; None for any other."""
    lists = [inner_value for inner_value in value.values() if isinstance(inner_value, list)]
    if not isinstance(value.get("unit"), str) or len(lists) != 1:
        return None
    return lists[0] if all(isinstance(cell, int | float | None) for cell in lists[0]) else None


def _column(values: Iterable[Any]) -> Array:
    """Return numbers (n,) or (n, k), NaN in place of null, or texts (n,); raises ValueError, TypeError."""
    cells = list(values)
    if any(isinstance(cell, str) for cell in cells):
        return np.array(["" if cell is None else str(cell) for cell in cells])
    rows: list[Any] = []
    for cell in cells:
        if isinstance(cell, list):
            rows.append([math.nan if number is None else number for number in cell])
        else:
            rows.append(math.nan if cell is None else cell)
    return np.array(rows, dtype=np.float64)


_READERS: Mapping[str, Callable[[Path], Iterable[tuple[Sequence[str], Any]]]] = {
    ".npy": _npy_arrays,
    ".npz": _npz_arrays,
    ".mat": _mat_arrays,
    ".h5": _hdf5_arrays,
    ".hdf5": _hdf5_arrays,
    ".parquet": _parquet_arrays,
    ".feather": _feather_arrays,
    ".json": _json_arrays,
    ".jsonl": _json_arrays,
    ".ndjson": _json_arrays,
}
ARRAY_FILES = tuple(_READERS)
