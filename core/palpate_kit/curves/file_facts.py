"""The facts of files: those stated of all of them, and those that ``curves.csv`` next to them states of each."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from palpate_kit.curves.curve import Curve
from palpate_kit.curves.curve_list import PLACES, Entries, cells_beside
from palpate_kit.curves.stated_facts import StatedFacts, stated_facts


@dataclass(frozen=True)
class FileFacts:
    """The facts that are stated of all files, and the cells of each curve in ``curves.csv``."""

    stated: StatedFacts
    cells: Entries = field(default_factory=dict)

    def of(self, curve: str) -> StatedFacts:
        """Return the facts of one curve; raises LogError for a cell that does not state its fact."""
        return self.stated.of_curve(self.cells.get(curve, {}))

    def listed(self, curves: Iterable[Curve], tables: Mapping[str, Any]) -> Entries:
        """Return the cells of curves that a pipeline of such `tables` reads, without the facts that options state."""
        return {
            curve.name: self.stated.without_options(self.cells[curve.name], tables)
            for curve in curves
            if curve.name in self.cells
        }


def file_facts(sources: Sequence[Path], curves: Iterable[Curve], stated: StatedFacts) -> FileFacts:
    """Return the facts of the curves of some sources; raises LogError.

    A place that a curve's file states counts unless ``curves.csv`` states one.
    """
    known_curves = [*curves]
    cells = cells_beside(sources, known_curves)
    for curve in known_curves:
        if curve.place is not None:
            place_cells = {name: repr(number) for name, number in zip(PLACES, curve.place, strict=True)}
            cells[curve.name] = {**place_cells, **cells.get(curve.name, {})}
    return FileFacts(stated, cells)


def facts_beside(file: Path, record: str | None = None, overrides: Iterable[str] = ()) -> StatedFacts:
    """Return the facts of a curve that options, ``curves.csv`` and ``rig.toml`` next to its file state.

    Raises LogError, ConfigurationError.
    """
    curve = Curve(str(file), str(file.resolve()), record=record)
    return file_facts([file], [curve], stated_facts([file], overrides)).of(curve.name)
