"""The pipelines by which the curves of a folder of fits are read and fitted."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

from palpate import LogError
from palpate_engine import DIALECT, Pipeline, Source, build_pipeline, inherited_approval, toml_tables

from palpate_kit.curves.curve_fits import CurveReader
from palpate_kit.curves.curve_list import RECORD
from palpate_kit.curves.fit_folder import FitFolder
from palpate_kit.curves.folder_settings import SETTINGS


def curve_reader(folder: FitFolder, dialect: str = "") -> CurveReader:
    """Return how the curves of a dialect are read and fitted; raises LogError unless one device has a file.

    A dialect names the curves of a folder whose files one pipeline reads; the first of a folder is "". If that file is
    gone, the reader overrides it by the first file of a curve of the dialect that exists.
    """
    path, text = folder.path / SETTINGS, folder.settings_text(dialect)
    device, file = _file_device(path, text)
    # A pipeline is built with a file that exists: that of its text may be gone.
    overrides: tuple[str, ...] = ()
    if not (folder.path / file).exists():
        curves = (curve for curve in folder.curves() if folder.dialect_of(curve.name) == dialect)
        files = [curve.file for curve in curves if Path(curve.file).exists()]
        overrides = tuple(f"device.{device}.file={json.dumps(file)}" for file in files[:1])
    return CurveReader(
        text=text,
        path=str(path.resolve()),
        overrides=overrides,
        device=device,
        approved=folder.approved,
        settings=text,
    )


def _file_device(path: Path, text: str) -> tuple[str, str]:
    """Return the name and the file of the one device with a file in the text of a pipeline; raises LogError."""
    tables = toml_tables(text).get("device")
    devices = tables if isinstance(tables, dict) else {}
    files = [
        (name, str(table["file"])) for name, table in devices.items() if isinstance(table, dict) and "file" in table
    ]
    if len(files) != 1:
        raise LogError(f"{path}: has {len(files)} devices with a file; one is needed")
    return files[0]


def dialect_source(folder: FitFolder, dialect: str = "", more: Iterable[str] = (), text: str = "") -> Source:
    """Return the pipeline of a dialect, or a `text` in its place, with a file that exists and `more` settings.

    Raises LogError, ConfigurationError.
    """
    reader = curve_reader(folder, dialect)
    source = Source(text or reader.text, folder.path / SETTINGS)
    for assignment in (*reader.overrides, *more):
        source.override(assignment)
    return source


def dialect_pipeline(folder: FitFolder, dialect: str = "", more: Iterable[str] = ()) -> Pipeline:
    """Return the pipeline of a dialect, with a file that exists and `more` settings; raises UserError."""
    source = dialect_source(folder, dialect, more)
    with inherited_approval(folder.approved):
        return build_pipeline(source)


def curve_source(folder: FitFolder, curve: str) -> Source:
    """Return the pipeline of one curve, with its file, record and settings; raises LogError."""
    source = Source(folder.settings_text(folder.dialect_of(curve)), folder.path / SETTINGS)
    for assignment in (*_file_assignments(folder, curve), *folder.settings_of(curve)):
        source.override(assignment)
    return source


def curve_assignments(folder: FitFolder, curve: str) -> tuple[str, ...]:
    """Return dialect, file and settings of a curve as ``--set`` of ``pipeline.toml``."""
    dialect = folder.dialect_of(curve)
    dialect_assignment = [f"run.{DIALECT}={json.dumps(dialect)}"] if dialect else []
    return (*dialect_assignment, *_file_assignments(folder, curve), *folder.settings_of(curve))


def pipeline_counts(folder: FitFolder, names: Iterable[str]) -> list[tuple[Pipeline, int]]:
    """Return the different pipelines of curves with the number of curves of each, the most frequent first.

    Raises UserError.
    """
    counts = Counter((folder.dialect_of(name), folder.settings_of(name)) for name in names)
    return [(dialect_pipeline(folder, dialect, more), count) for (dialect, more), count in counts.most_common()]


def _file_assignments(folder: FitFolder, curve: str) -> Sequence[str]:
    """Return the file and the record of a curve as ``--set``."""
    device = curve_reader(folder, folder.dialect_of(curve)).device
    values = {"file": folder.file_of(curve), RECORD: folder.curve(curve).record}
    return [f"device.{device}.{key}={json.dumps(text)}" for key, text in values.items() if text]
