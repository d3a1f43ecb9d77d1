"""Topics as files that other programs read: one table (.csv, .parquet), or one array for each field (.npz, .mat).

`topic_files` of a function here are the topics of a log by their keys: a topic of numbers has its name, its texts have
a key of their own.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from palpate import ConfigurationError, Floats

from palpate_logs.table_windows import column_names, table_windows, unique_names
from palpate_logs.topic_arrays import TopicFiles

_MAX_MATLAB_NAME = 63  # characters of a name, by MATLAB's namelengthmax
_NANOSECONDS = 1e9  # [1/s]


def _write_csv(path: Path, topic_files: Mapping[str, TopicFiles]) -> dict[str, str]:
    """Write a table with time-stamps [ns], times [s] since the first message, and an empty cell for NaN.

    Return changed names of topics as every writer does; a table has none.
    """
    first_stamp = min(int(files.stamps(0, 1)[0]) for files in topic_files.values() if len(files))
    texts = _texts_by_column(topic_files)
    with path.open("x", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["stamp_ns", "time_s", *chain.from_iterable(column_names(topic_files).values())])
        for stamps, columns in table_windows(topic_files):
            seconds = (stamps - first_stamp) / _NANOSECONDS
            cells = [
                _decode_texts(column, texts[name]) if name in texts else column.tolist()
                for name, column in columns.items()
            ]
            for row in zip(stamps.tolist(), seconds.tolist(), *cells, strict=True):
                writer.writerow(["" if cell != cell else cell for cell in row])  # NaN differs from itself
    return {}


def _texts_by_column(topic_files: Mapping[str, TopicFiles]) -> dict[str, tuple[str, ...]]:
    """Return the texts of each column of texts, by their codes, for the name of the column."""
    names = column_names(topic_files)
    texts: dict[str, tuple[str, ...]] = {}
    for key, files in topic_files.items():
        texts.update(zip(names[key], files.texts, strict=False))
    return texts


def _decode_texts(codes: Floats, texts: tuple[str, ...]) -> list[str]:
    """Return the texts for the codes (n,) of a column, which are indices; an empty one for NaN."""
    return ["" if code != code else texts[int(code)] for code in codes.tolist()]


def _fields(topic_files: Sequence[TopicFiles]) -> Iterator[tuple[str, Any]]:
    """Yield name and array (n,) of each field of a topic, from its files of numbers and of texts.

    The time-stamps come first; those of the texts are a field of their own if they are others.
    """
    first_stamps = topic_files[0].stamps()
    for index, files in enumerate(topic_files):
        if index == 0 or not np.array_equal(files.stamps(), first_stamps):
            yield "stamp_ns", files.stamps()
        for k, name in enumerate(files.names):
            column = files.column(k)
            yield name, np.array(_decode_texts(column, files.texts[k]), str) if files.texts else column


def _arrays_by_topic(
    topic_files: Mapping[str, TopicFiles], allowed_name: Callable[[str], str], max_length: int | None = None
) -> dict[str, tuple[str, dict[str, Any]]]:
    """Return for each topic its name in a file, and there the arrays of its fields by name.

    `allowed_name` makes of any name one that the file allows.
    """
    files_by_topic: dict[str, list[TopicFiles]] = {}  # of numbers, of texts or of both
    for files in topic_files.values():
        files_by_topic.setdefault(files.topic, []).append(files)
    topic_names = unique_names(map(allowed_name, files_by_topic), max_length)
    arrays_by_topic = {}
    for topic, topic_name in zip(files_by_topic, topic_names, strict=True):
        fields = [*_fields(files_by_topic[topic])]
        field_names = unique_names((allowed_name(name) for name, _ in fields), max_length)
        arrays_by_topic[topic] = topic_name, dict(zip(field_names, (array for _, array in fields), strict=True))
    return arrays_by_topic


def _write_npz(path: Path, topic_files: Mapping[str, TopicFiles]) -> dict[str, str]:
    """Write an array for each field, as "wrench:wrench.force.z"; return the changed names of topics."""
    topics = _arrays_by_topic(topic_files, _dotted_name)
    arrays = [(f"{name}:{field}", array) for name, fields in topics.values() for field, array in fields.items()]
    names = unique_names(name for name, _ in arrays)
    with path.open("xb") as file:
        np.savez_compressed(file, **{name: array for name, (_, array) in zip(names, arrays, strict=True)})
    return {topic: name for topic, (name, _) in topics.items() if name != _dotted_name(topic)}


def _dotted_name(name: str) -> str:
    """Return a name with points in place of slashes, which NumPy's archives take for folders."""
    return name.strip("/").replace("/", ".")


def _write_mat(path: Path, topic_files: Mapping[str, TopicFiles]) -> dict[str, str]:
    """Write a struct for each topic, by names that MATLAB allows; return the changed names of topics."""
    from scipy.io import savemat

    topics = _arrays_by_topic(topic_files, _matlab_name, _MAX_MATLAB_NAME)
    with path.open("xb") as file:
        savemat(file, dict(topics.values()), long_field_names=True, do_compression=True)
    return {topic: name for topic, (name, _) in topics.items() if name != _matlab_name(topic)[:_MAX_MATLAB_NAME]}


def _matlab_name(name: str) -> str:
    """Return a name of letters, digits and underscores that begins with a letter."""
    identifier = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_")
    return identifier if identifier[:1].isalpha() else f"x{identifier}"


def _write_parquet(path: Path, topic_files: Mapping[str, TopicFiles]) -> dict[str, str]:
    """Write a table with time-stamps [ns]; raises ConfigurationError if pyarrow is not installed.

    Return changed names of topics as every writer does; a table has none.
    """
    try:
        import pyarrow  # type: ignore[import-not-found,import-untyped,unused-ignore]
        import pyarrow.parquet  # type: ignore[import-not-found,import-untyped,unused-ignore]
    except ImportError as error:
        raise ConfigurationError("parquet needs a library that is not installed: pip install pyarrow") from error
    names = chain.from_iterable(column_names(topic_files).values())
    texts = _texts_by_column(topic_files)
    column_types = ((name, pyarrow.string() if name in texts else pyarrow.float64()) for name in names)
    schema = pyarrow.schema([("stamp_ns", pyarrow.int64()), *column_types])
    with pyarrow.parquet.ParquetWriter(path, schema, write_page_checksum=True) as writer:
        for stamps, columns in table_windows(topic_files):
            text_columns = {name: _decode_texts(columns[name], texts[name]) for name in texts}
            writer.write_table(pyarrow.table({"stamp_ns": stamps, **columns, **text_columns}))
    return {}


# By suffix; each returns the names in the file of topics whose own name there is that of another topic.
WRITERS: Mapping[str, Callable[[Path, Mapping[str, TopicFiles]], dict[str, str]]] = {
    ".csv": _write_csv,
    ".npz": _write_npz,
    ".mat": _write_mat,
    ".parquet": _write_parquet,
}
