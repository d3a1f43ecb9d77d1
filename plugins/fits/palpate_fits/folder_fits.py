"""The curves of a folder fitted: new ones, and those whose settings have changed."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from palpate_engine import Pipeline
from palpate_kit.curves.curve import Curve
from palpate_kit.curves.curve_fits import CurveReader, Row, offline, record_tracks
from palpate_kit.curves.curve_list import add_curves
from palpate_kit.curves.curve_table import FitTable, curves_folder
from palpate_kit.curves.fit_folder import FitFolder
from palpate_kit.curves.own_settings import read_own
from palpate_kit.terminal.progress import report_progress

from palpate_fits.curve_pool import on_cores

Pool = Callable[[CurveReader, Iterable[Curve]], Iterator[list[Row]]]  # the rows of every curve, in any order
FEW = 32  # curves that are not worth a second process


def fit_each(
    pipeline: Pipeline,
    reader: CurveReader,
    curves: Iterable[Curve],
    folder: Path,
    workers: int | None = None,
    dialect: str = "",
    fitting: bool = True,
    pool: Pool | None = None,
    cells: Mapping[str, Mapping[str, str]] = {},
) -> FitTable:
    """Fit every curve that has no row by its present settings yet, and append its rows.

    Curves that are known by their files are listed in ``curves.csv`` with `cells` of some; ``own.toml`` adds settings
    of single ones. Without `fitting` that is all. They are fitted by the `pool`, or by so many processes.
    Raises LogError, OutputError.
    """
    table = FitTable(folder, pipeline, reader.device, dialect)
    reader = replace(reader, settings=table.settings)
    if isinstance(curves, Sequence):
        add_curves(folder, curves, dialect, cells, curves_folder(folder))
        known = FitFolder(folder)  # a curve that own.toml names and that there is not is refused
        reader = known.reader(dialect)  # a first fit is made as every later one
        curves = [known.curve(curve.name) for curve in curves]
    elif own := read_own(folder):
        curves = (replace(curve, own=own.get(curve.name, ())) for curve in curves)
    left = table.left(curves, reader) if fitting else ()
    found = len(table.done)
    pool = pool or partial(on_cores, workers=workers or len(os.sched_getaffinity(0)))
    for count, rows in enumerate(pool(reader, left), start=found + 1):
        table.add(rows)
        report_progress(count)
    table.compact([curve.name for curve in curves] if isinstance(curves, Sequence) else ())
    return table


def refit(
    folder: FitFolder,
    names: Collection[str],
    workers: int | None = None,
    done: Callable[[str], object] = lambda name: None,
) -> int:
    """Repeat the fits of some curves of a folder that have no row by their present settings; their number.

    Each is reported to `done`. Raises LogError, OutputError, ConfigurationError.
    """
    count = 0
    for name in folder.dialects:
        curves = [curve for curve in folder.curves() if curve.name in names and folder.dialect_of(curve.name) == name]
        if not curves:
            continue
        reader = folder.reader(name)
        pipeline = offline(folder.pipeline(name))
        for own in dict.fromkeys(curve.own for curve in curves):
            record_tracks(reader, own)  # impossible settings are reported before anything is fitted
        table = FitTable(folder.path, pipeline, reader.device, name)
        left = list(table.left(curves, reader))
        few = workers or (1 if len(left) < FEW else len(os.sched_getaffinity(0)))
        for rows in on_cores(reader, left, few):
            table.add(rows)
            count += 1
            done(rows[0]["curve"])
        table.compact(folder.names)
    return count
