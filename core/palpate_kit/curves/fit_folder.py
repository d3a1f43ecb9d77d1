"""A folder of fits of many curves, read back: rows with their marks, groups and settings."""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from palpate import ConfigurationError, ContactModel, LogError, PalpateError, suggest
from palpate_engine import (
    DIALECT,
    RIG,
    RigFacts,
    Source,
    approved_plugins,
    build_parts,
    facts_left_open,
    inherited_approval,
    read_rig,
    registry,
    toml_tables,
    trusted_plugins,
)

from palpate_kit.curves.curve import Curve
from palpate_kit.curves.curve_fits import settings_key, value_units
from palpate_kit.curves.curve_list import (
    FILE,
    LIST,
    RECORD,
    Entries,
    columns_of,
    fact_assignments,
    read_list,
)
from palpate_kit.curves.curve_row import CurveRow, stated_place
from palpate_kit.curves.curve_table import TABLE, columns_in, demand_columns, fitted_rows
from palpate_kit.curves.folder_settings import SETTINGS, curves_folder, dialects_in, settings_text
from palpate_kit.curves.own_settings import Own, read_own
from palpate_kit.curves.row_summary import summary_of
from palpate_kit.runs.review_file import Marks, read_marks


def is_fit_folder(path: Path) -> bool:
    """Return True if a folder holds fits of many curves."""
    return (path / TABLE).exists()


def stale_words(folder: FitFolder) -> str:
    """Return a sentence on rows that were made with other settings; empty without any."""
    rows = folder.rows
    old = sum(row.state == "stale" for row in rows)
    anew = f"palpate fit {folder.path} repeats them"
    return f"{old} of {len(rows)} rows were made with other settings: {anew}" if old else ""


@dataclass(frozen=True)
class FitFolder:
    """A folder of fits of many curves."""

    path: Path

    @property
    def dialects(self) -> list[str]:
        """The dialects in which its curves are written, that of the pipeline's own tables, which has no name, first."""
        return dialects_in(self.path / SETTINGS)

    def settings_text(self, dialect: str = "") -> str:
        """Return the text of the pipeline of a dialect; raises LogError."""
        return settings_text(self.path / SETTINGS, dialect)

    @property
    def table(self) -> Path:
        """Its ``fits.csv``."""
        return self.path / TABLE

    @cached_property
    def cells(self) -> list[dict[str, str]]:
        """The latest rows of ``fits.csv``, but for files that could not be read; raises LogError."""
        if not self.table.exists():
            return []
        demand_columns(self.table)
        return fitted_rows(self.table)

    @cached_property
    def entries(self) -> Entries:
        """``curves.csv``; raises LogError where it names a curve or a dialect that there is not."""
        found = read_list(self.path / LIST, {row["curve"] for row in self.cells})
        known = self.dialects if any(cells.get(DIALECT) for cells in found.values()) else [""]
        for curve, cells in found.items():
            if (name := cells.get(DIALECT, "")) not in known:
                raise LogError(f"{self.path / LIST}: {curve}: no dialect {name!r}{suggest(name, known)}")
        return found

    @property
    def columns(self) -> list[str]:
        """Columns of ``curves.csv`` by which curves can be grouped."""
        return columns_of(self.entries.values())

    @cached_property
    def names(self) -> list[str]:
        """All curves, fitted or not, in their order."""
        return list(dict.fromkeys((*self.entries, *(row["curve"] for row in self.cells))))

    @cached_property
    def own(self) -> Own:
        """``own.toml``; raises LogError where it names a curve that there is not."""
        return read_own(self.path, self.names)

    def settings_of(self, curve: str) -> tuple[str, ...]:
        """Return the settings of one curve: the facts in ``rig.toml``, those in ``curves.csv``, then ``own.toml``."""
        return (*self.facts_left_open(self.dialect_of(curve)), *self.own_of(curve))

    def names_of(self, file: Path, record: str | None = None) -> list[str]:
        """Return the curves of a file, or of one record in it; none for a file that is not of the folder."""
        curves = [curve for curve in self.curves() if os.path.realpath(curve.file) == os.path.realpath(file)]
        return [curve.name for curve in curves if record is None or curve.record == record]

    def own_of(self, curve: str) -> tuple[str, ...]:
        """Return the settings of one curve that others need not have."""
        return (*fact_assignments(self.entries.get(curve, {})), *self.own.get(curve, ()))

    @cached_property
    def facts(self) -> RigFacts:
        """``rig.toml``; raises LogError for one with mistakes."""
        path = self.path / RIG
        try:
            return read_rig(path) if path.is_file() else RigFacts()
        except ConfigurationError as error:
            raise LogError(str(error)) from error

    def facts_left_open(self, dialect: str) -> tuple[str, ...]:
        """Return the facts that the pipeline of a dialect leaves open, as settings; raises LogError."""
        if dialect not in self._open:
            tables = toml_tables(self.settings_text(dialect)) if self.facts != RigFacts() else {}
            self._open[dialect] = tuple(facts_left_open(tables, self.facts, registry.load()) if tables else ())
        return self._open[dialect]

    @cached_property
    def _open(self) -> dict[str, tuple[str, ...]]:
        """Those facts by dialect; filled as they are asked for."""
        return {}

    @cached_property
    def marks(self) -> Marks:
        """``review.json``; raises LogError."""
        return read_marks(self.path)

    @cached_property
    def by_curve(self) -> dict[str, list[dict[str, str]]]:
        """The latest rows of ``fits.csv`` of each curve, none where it has none yet."""
        found: dict[str, list[dict[str, str]]] = {name: [] for name in self.names}
        for row in self.cells:
            found[row["curve"]].append(row)
        return found

    @cached_property
    def keys(self) -> dict[tuple[str, tuple[str, ...]], str]:
        """The present names of settings, by pipeline and a curve's own; filled as they are asked for."""
        return {}

    def key(self, curve: str) -> str:
        """What the present settings of a curve are called."""
        kind = self.dialect_of(curve), self.settings_of(curve)
        if kind not in self.keys:
            self.keys[kind] = settings_key(self.settings_text(kind[0]), kind[1])
        return self.keys[kind]

    def rows_of(self, curve: str) -> list[CurveRow]:
        """Return the rows of a curve, or one without cells."""
        groups, key = self.entries.get(curve, {}), self.key(curve)
        marked = (self.marks.rejected.get(curve), curve in self.marks.accepted)
        rows = self.by_curve[curve] or [{}]
        return [CurveRow(curve, row.get("track", ""), row, groups, *marked, row.get("settings") == key) for row in rows]

    @property
    def rows(self) -> list[CurveRow]:
        """Every row, and one without cells for each curve that has none yet; raises LogError."""
        return [row for name in self.names for row in self.rows_of(name)]

    @property
    def tracks(self) -> list[str]:
        """Names of the tracks."""
        return list(dict.fromkeys(row["track"] for row in self.cells if row["track"]))

    @cached_property
    def values(self) -> list[str]:
        """Names of the values of a row, the surface last."""
        head = columns_in(self.table) if self.table.exists() else ()
        return [name.removesuffix("_combined") for name in head if name.endswith("_combined")]

    @property
    def summary(self) -> dict[str, dict[str, Any]]:
        """By track: curves, those that failed or are flagged, and quartiles of each value but the surface."""
        return summary_of(self.cells, self.values[:-1])

    def curves(self) -> list[Curve]:
        """Return the curves whose files are known, with their own settings."""
        return [self.curve(name) for name in self.names if self.file_of(name)]

    def curve(self, name: str) -> Curve:
        """Return a curve whose file is known, with its own settings."""
        cells = self.entries.get(name, {})
        place = stated_place(cells)
        return Curve(name, self.file_of(name), (), self.settings_of(name), cells.get(RECORD) or None, place)

    def file_of(self, curve: str) -> str:
        """Return the file of a curve, which ``curves.csv`` names as seen from a folder; "" where it is not known."""
        file = self.entries.get(curve, {}).get(FILE, "")
        return os.path.normpath((self.curves_folder or self.path.resolve()) / file) if file else ""

    @cached_property
    def curves_folder(self) -> Path | None:
        """The folder from which the files of curves are seen; None for this one."""
        return curves_folder(self.path)

    @property
    def approved(self) -> frozenset[str]:
        """SHA-256 of the plugin files that its pipelines may name: nothing in the folder is consent to one."""
        return approved_plugins().union(trusted_plugins())

    def dialect_of(self, curve: str) -> str:
        """Return the dialect in which a curve is written; "" for that of the pipeline's own tables."""
        return self.entries.get(curve, {}).get(DIALECT, "")

    @cached_property
    def _models(self) -> tuple[ContactModel, ...]:
        """The models, whether the files of curves are there or not; none where they cannot be built again."""
        with suppress(PalpateError), inherited_approval(self.approved):
            return tuple(build_parts(Source(self.settings_text(), self.path / SETTINGS), "model").values())
        return ()

    @cached_property
    def units(self) -> dict[str, str]:
        """SI unit of each value; none where the models cannot be built again."""
        found = {"surface": "m"}
        for model in self._models:
            found |= value_units(model)
        return found

    @cached_property
    def symbols(self) -> dict[str, str]:
        """Name of each value by its symbol."""
        found = {"E": "elasticity", "eta": "viscosity"}
        found |= {parameter.symbol: parameter.name for model in self._models for parameter in model.parameters}
        return {symbol: name for symbol, name in found.items() if name in self.values}
