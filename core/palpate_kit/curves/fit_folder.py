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
    stale_count = sum(row.state == "stale" for row in rows)
    if not stale_count:
        return ""
    remedy = f"palpate fit {folder.path} repeats them"
    return f"{stale_count} of {len(rows)} rows were made with other settings: {remedy}"


@dataclass(frozen=True)
class FitFolder:
    """A folder of fits of many curves."""

    path: Path

    @property
    def dialects(self) -> list[str]:
        """The dialects in which its curves are written; first "", that of the pipeline's main tables."""
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
        """``curves.csv``; raises LogError for an unknown curve or dialect."""
        entries = read_list(self.path / LIST, {row["curve"] for row in self.cells})
        names_a_dialect = any(cells.get(DIALECT) for cells in entries.values())
        dialects = self.dialects if names_a_dialect else [""]  # the settings are read only if needed
        for curve, cells in entries.items():
            if (name := cells.get(DIALECT, "")) not in dialects:
                raise LogError(f"{self.path / LIST}: {curve}: no dialect {name!r}{suggest(name, dialects)}")
        return entries

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
        """``own.toml``; raises LogError for an unknown curve."""
        return read_own(self.path, self.names)

    def settings_of(self, curve: str) -> tuple[str, ...]:
        """Return the settings of one curve: the facts in ``rig.toml``, those in ``curves.csv``, then ``own.toml``."""
        return (*self.facts_left_open(self.dialect_of(curve)), *self.own_of(curve))

    def names_of(self, file: Path, record: str | None = None) -> list[str]:
        """Return the curves of a file, or of one record in it; none for a file that is not of the folder."""
        curves = [curve for curve in self.curves() if os.path.realpath(curve.file) == os.path.realpath(file)]
        return [curve.name for curve in curves if record is None or curve.record == record]

    def own_of(self, curve: str) -> tuple[str, ...]:
        """Return the settings of one curve alone: the facts in ``curves.csv``, then ``own.toml``."""
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
        """Return the facts of ``rig.toml`` that the pipeline of a dialect leaves open, as settings; raises LogError."""
        if dialect not in self._open_facts:
            tables = toml_tables(self.settings_text(dialect)) if self.facts != RigFacts() else {}
            self._open_facts[dialect] = tuple(facts_left_open(tables, self.facts, registry.load()) if tables else ())
        return self._open_facts[dialect]

    @cached_property
    def _open_facts(self) -> dict[str, tuple[str, ...]]:
        """The results of `facts_left_open` by dialect, filled at its calls."""
        return {}

    @cached_property
    def marks(self) -> Marks:
        """``review.json``; raises LogError."""
        return read_marks(self.path)

    @cached_property
    def by_curve(self) -> dict[str, list[dict[str, str]]]:
        """The latest rows of ``fits.csv`` of each curve; empty for a curve that is not fitted yet."""
        rows: dict[str, list[dict[str, str]]] = {name: [] for name in self.names}
        for row in self.cells:
            rows[row["curve"]].append(row)
        return rows

    @cached_property
    def keys(self) -> dict[tuple[str, tuple[str, ...]], str]:
        """The results of `key` by dialect and settings of a curve, filled at its calls."""
        return {}

    def key(self, curve: str) -> str:
        """Return the key of the present settings of a curve, with which rows that are not stale were fitted."""
        dialect = self.dialect_of(curve)
        settings = self.settings_of(curve)
        if (dialect, settings) not in self.keys:
            self.keys[dialect, settings] = settings_key(self.settings_text(dialect), settings)
        return self.keys[dialect, settings]

    def rows_of(self, curve: str) -> list[CurveRow]:
        """Return the rows of a curve, one for each track, or one without cells if it is not fitted yet.

        `groups` are its cells of ``curves.csv``; a row is `current` if it was fitted with the present settings.
        """
        key = self.key(curve)
        return [
            CurveRow(
                curve=curve,
                track=cells.get("track", ""),
                cells=cells,
                groups=self.entries.get(curve, {}),
                rejected=self.marks.rejected.get(curve),
                accepted=curve in self.marks.accepted,
                current=cells.get("settings") == key,
            )
            for cells in self.by_curve[curve] or [{}]
        ]

    @property
    def rows(self) -> list[CurveRow]:
        """Every row, and one without cells for each curve that is not fitted yet; raises LogError."""
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
        return Curve(
            name,
            file=self.file_of(name),
            own=self.settings_of(name),
            record=cells.get(RECORD) or None,
            place=stated_place(cells),
        )

    def file_of(self, curve: str) -> str:
        """Return the file of a curve, which ``curves.csv`` names relative to a folder; "" if it is not known."""
        file = self.entries.get(curve, {}).get(FILE, "")
        return os.path.normpath((self.curves_folder or self.path.resolve()) / file) if file else ""

    @cached_property
    def curves_folder(self) -> Path | None:
        """The folder to which the files of curves are relative; None for this one."""
        return curves_folder(self.path)

    @property
    def approved(self) -> frozenset[str]:
        """SHA-256 of the plugin files that its pipelines may name: approved by the user, not by the folder."""
        return approved_plugins().union(trusted_plugins())

    def dialect_of(self, curve: str) -> str:
        """Return the dialect in which a curve is written; "" for that of the pipeline's own tables."""
        return self.entries.get(curve, {}).get(DIALECT, "")

    @cached_property
    def _models(self) -> tuple[ContactModel, ...]:
        """The models, for which the files of curves need not exist; empty if they cannot be built again."""
        with suppress(PalpateError), inherited_approval(self.approved):
            return tuple(build_parts(Source(self.settings_text(), self.path / SETTINGS), "model").values())
        return ()

    @cached_property
    def units(self) -> dict[str, str]:
        """SI unit of each value; of the surface alone if the models cannot be built again."""
        units = {"surface": "m"}
        for model in self._models:
            units |= value_units(model)
        return units

    @cached_property
    def symbols(self) -> dict[str, str]:
        """Name of each value by its symbol."""
        names = {"E": "elasticity", "eta": "viscosity"}
        names |= {parameter.symbol: parameter.name for model in self._models for parameter in model.parameters}
        return {symbol: name for symbol, name in names.items() if name in self.values}
