"""From the curves of a folder to their rows: those that have none by their present settings are fitted."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from palpate_engine import Pipeline

from palpate_kit.curves.curve import Curve
from palpate_kit.curves.curve_fits import CurveReader, Row, offline, record_tracks
from palpate_kit.curves.curve_list import add_curves
from palpate_kit.curves.curve_pipelines import curve_reader, dialect_pipeline
from palpate_kit.curves.curve_pool import on_cores
from palpate_kit.curves.curve_table import FitTable
from palpate_kit.curves.fit_folder import FitFolder
from palpate_kit.curves.folder_settings import curves_folder
from palpate_kit.curves.own_settings import read_own
from palpate_kit.jobs.process_pool import core_count
from palpate_kit.terminal.progress import progress, report_progress

Pool = Callable[[CurveReader, Iterable[Curve]], Iterator[list[Row]]]  # the rows of every curve, in any order
FEW = 32  # curves, below which a second process takes longer to start than it saves: a choice


@dataclass
class CurveGroup:
    """Curves that one device of one pipeline reads."""

    pipeline: Pipeline
    device: str
    curves: list[Curve] = field(default_factory=list)


def list_curves(path: Path, groups: Iterable[CurveGroup], cells: Mapping[str, Mapping[str, str]]) -> FitFolder:
    """Begin a folder of fits, or continue one, with the pipeline of each group and its curves; `cells` are of some.

    Raises LogError, OutputError.
    """
    for number, group in enumerate(groups, start=1):
        dialect = dialect_name(number)
        FitTable(path, group.pipeline, group.device, dialect)
        add_curves(path, group.curves, dialect, cells, curves_folder(path))
    return FitFolder(path)


def dialect_name(number: int) -> str:
    """Return the name of a dialect by its number from 1: "", "d2", "d3"; a spreadsheet would reformat bare numbers."""
    return "" if number == 1 else f"d{number}"


def table_of(folder: FitFolder, dialect: str = "") -> FitTable:
    """Return the table of the curves of a dialect; raises UserError."""
    pipeline = offline(dialect_pipeline(folder, dialect))
    return FitTable(folder.path, pipeline, curve_reader(folder, dialect).device, dialect)


def fit_rows(
    folder: FitFolder,
    names: Sequence[str],
    workers: int | None = None,
    pool: Pool | None = None,
    order: Sequence[str] | None = None,
) -> int:
    """Fit the named curves that have no row by their present settings, and add their rows; return their number.

    The `pool` fits them, else a number of `workers`: by default one for fewer than FEW curves, and one per core for
    more. The rows of the table are then in the `order` of names, by default that of the folder. Raises UserError.
    """
    # What is stale is known before anything is fitted, for the total of the progress.
    stale: list[tuple[FitTable, CurveReader, list[Curve]]] = []
    for dialect, curves in _curves_by_dialect(folder, names):
        table, reader = table_of(folder, dialect), curve_reader(folder, dialect)
        stale.append((table, reader, list(table.unfitted_curves(curves, reader))))
    count = 0
    with progress("fit", "curves", sum(len(curves) for _, _, curves in stale)):
        for table, reader, curves in stale:
            processes = workers or (1 if len(curves) < FEW else core_count())
            count += _add_rows(table, reader, curves, pool or partial(on_cores, workers=processes), count)
            table.compact(folder.names if order is None else order)
    return count


def demand_settings(folder: FitFolder, names: Collection[str]) -> None:
    """Raise ConfigurationError if the pipeline of one of the named curves cannot be built."""
    for dialect, curves in _curves_by_dialect(folder, names):
        reader = curve_reader(folder, dialect)
        for assignments in dict.fromkeys(curve.own for curve in curves):
            record_tracks(reader, assignments)


def fit_stream(path: Path, pipeline: Pipeline, reader: CurveReader, curves: Iterable[Curve], pool: Pool) -> None:
    """Fit the curves of a stream of readings into the table of a folder; ``own.toml`` has settings of single ones.

    Raises LogError, OutputError.
    """
    table = FitTable(path, pipeline, reader.device)
    reader = replace(reader, settings=table.settings)
    assignments = read_own(path)
    stated = (replace(curve, own=assignments.get(curve.name, ())) for curve in curves)
    with progress("fit", "curves"):
        _add_rows(table, reader, table.unfitted_curves(stated, reader), pool, len(table.done))
    table.compact()


def _curves_by_dialect(folder: FitFolder, names: Collection[str]) -> list[tuple[str, list[Curve]]]:
    """Return the named curves whose files are known, by dialect; without the dialects of none of them."""
    chosen_names = {*names}
    by_dialect: dict[str, list[Curve]] = {dialect: [] for dialect in folder.dialects}
    for curve in folder.curves():
        if curve.name in chosen_names:
            by_dialect[folder.dialect_of(curve.name)].append(curve)
    return [(dialect, curves) for dialect, curves in by_dialect.items() if curves]


def _add_rows(table: FitTable, reader: CurveReader, curves: Iterable[Curve], pool: Pool, before: int) -> int:
    """Append the rows of curves as they are ready; return the number of curves.

    The progress that is reported begins at the number of curves done `before`.
    """
    count = 0
    for count, rows in enumerate(pool(reader, curves), start=1):
        table.add(rows)
        report_progress(before + count)
    return count
