"""The facts of a folder of fits, for its report and its methods: measurement, settings and fits of its curves."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from palpate_engine import Pipeline, registry
from palpate_kit.curves.curve_fits import row_conditions
from palpate_kit.curves.curve_pipelines import pipeline_counts
from palpate_kit.curves.curve_row import CurveRow
from palpate_kit.curves.fit_folder import FitFolder
from palpate_kit.curves.fit_provenance import FitProvenance, read_provenance
from palpate_kit.curves.row_results import result_row
from palpate_kit.terminal.result_table import ResultTable


@dataclass(frozen=True)
class FolderFacts:
    """A folder of fits, and those of its rows that are reported: of one track, one for each curve."""

    folder: FitFolder
    track: str
    rows: Sequence[CurveRow]

    @cached_property
    def pipelines(self) -> list[tuple[Pipeline, int]]:
        """The pipelines that the rows were made with and their numbers, that of most first; raises UserError.

        Curves that could not be read or fitted count only if all are such.
        """
        names = [row.curve for row in self.rows if not row.error] or [row.curve for row in self.rows]
        return pipeline_counts(self.folder, names)

    @cached_property
    def used(self) -> list[CurveRow]:
        """The rows whose values enter statistics."""
        return [row for row in self.rows if row.usable]

    @cached_property
    def values(self) -> list[str]:
        """Names of the values of which a used row has a number, but for the surface."""
        return [
            name for name in self.folder.values[:-1] if any(row.usable_number(name) is not None for row in self.used)
        ]

    @cached_property
    def table(self) -> ResultTable:
        """The rows whose values enter statistics, as the table of results."""
        folder = self.folder
        units = {name: folder.units.get(name, "") for name in folder.values if name != "surface"}
        severities = {code: meaning.severity for code, meaning in registry.load().meanings.items()}
        return ResultTable(tuple(result_row(row.cells, units, severities) for row in self.used))

    @cached_property
    def exclusions(self) -> dict[str, int]:
        """Reasons of excluded curves with their numbers, the most frequent first."""
        return dict(Counter(exclusion_of(row) for row in self.rows if not row.usable).most_common())

    @cached_property
    def conditions(self) -> dict[str, tuple[str, int]]:
        """The facts that nobody has stated, each with its most frequent sentence, and the number of rows it is of."""
        texts: dict[str, Counter[str]] = {}
        for row in self.used:
            for fact, sentence in row_conditions(row.cells).items():
                texts.setdefault(fact, Counter())[sentence] += 1
        return {fact: (counts.most_common(1)[0][0], counts.total()) for fact, counts in texts.items()}

    @cached_property
    def instrument(self) -> str | None:
        """Instrument in the file of facts of the folder; None without one; raises LogError."""
        return self.folder.facts.instrument

    @property
    def provenance(self) -> list[FitProvenance]:
        """Commands and versions; raises LogError."""
        return read_provenance(self.folder.path)

    @property
    def own_settings(self) -> int:
        """Of how many rows ``own.toml`` has settings of the curve."""
        return sum(bool(self.folder.own.get(row.curve)) for row in self.rows)

    def typical(self, name: str) -> CurveRow | None:
        """Return the used row whose value is the middle one; None where none has a number."""
        ranked = sorted((value, row.curve, row) for row in self.used if (value := row.usable_number(name)) is not None)
        return ranked[(len(ranked) - 1) // 2][2] if ranked else None

    def relative_uncertainty(self, name: str) -> tuple[float, float] | None:
        """Median of the relative combined uncertainty of a value, and of its part that all curves share."""
        pairs = [
            (row.number(f"{name}_combined"), row.systematic(name), row.usable_number(name))
            for row in self.used
        ]  # fmt: skip
        shares = [(u / abs(v), (shared or 0.0) / abs(v)) for u, shared, v in pairs if u is not None and v]
        return tuple(float(number) for number in np.median(np.array(shares), axis=0)) if shares else None  # type: ignore[return-value]


def exclusion_of(row: CurveRow) -> str:
    """Return why a curve is not used."""
    if row.rejected is not None:
        return f"rejected on inspection: {row.rejected or 'no reason stated'}"
    if row.state == "missing":
        return "not fitted yet"
    flags = ", ".join(row.flags)
    return f"invalid: {flags}" if flags else "could not be read or fitted"


def libraries(entries: Sequence[FitProvenance]) -> Mapping[str, str]:
    """Return the versions of the latest command, by name."""
    return entries[-1].versions if entries else {}
