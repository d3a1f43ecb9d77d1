"""One track of a run: its values, flags and estimates."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from palpate import ConfigurationError, Flag, suggest
from palpate_kit.runs.result_file import read_flags

from palpate_notebook.quantity import UncertainQuantity
from palpate_notebook.suggestions import with_suggestions

if TYPE_CHECKING:
    import pandas
    import xarray


@with_suggestions
class TrackView:
    """Results of one contact model with one estimator."""

    def __init__(self, name: str, document: Mapping[str, Any], estimates: Callable[[], xarray.Dataset]) -> None:
        self.name, self.document = name, document
        self._estimates = estimates  # returns those of all tracks; refers to the run, and so keeps its folder

    @property
    def parameters(self) -> dict[str, UncertainQuantity]:
        """The model's parameters, then the values that follow from them, by name."""
        budget_rows = self.document.get("budget", ())
        quantities = {}
        for name, table in self.document["parameters"].items():
            quantities[name] = UncertainQuantity.of(name, table, _contributions(budget_rows, name))
        for name, table in self.document.get("derived", {}).items():
            quantities[name] = UncertainQuantity.of(name, table)
        return quantities

    def __getitem__(self, name: str) -> UncertainQuantity:
        parameters = self.parameters
        if name not in parameters:
            raise ConfigurationError(f"{self.name} has no {name!r}{suggest(name, parameters)}")
        return parameters[name]

    @property
    def elasticity(self) -> UncertainQuantity:
        """Young's modulus [Pa]; raises ConfigurationError where the model does not give it."""
        return self["elasticity"]

    @property
    def viscosity(self) -> UncertainQuantity:
        """The material's viscosity [Pa s]; raises ConfigurationError where the model does not give it."""
        return self["viscosity"]

    @property
    def surface(self) -> UncertainQuantity:
        """Height of the untouched surface [m]."""
        return UncertainQuantity.of("surface", self.document["surface"])

    @property
    def verdict(self) -> str:
        """The verdict on the elasticity; for a model without one the worst of the verdicts on its values."""
        return str(self.document["verdict"])

    @property
    def flags(self) -> tuple[Flag, ...]:
        """The flags on the track, with those on the whole record."""
        return read_flags(self.document["flags"])

    @property
    def residual(self) -> float:
        """Root mean square of measured less modelled force [N]; NaN without estimates."""
        return _number(self.document["force_rms"])

    @property
    def nis(self) -> float:
        """Mean normalised innovation squared; 1 if model and noise are right."""
        return _number(self.document["nis"])

    @property
    def estimates(self) -> xarray.Dataset:
        """The estimates over time; dimension time, units in the attributes."""
        return self._estimates().sel(track=self.name)

    def budget(self) -> pandas.DataFrame:
        """Return every source of uncertainty with its contribution to each value, as a standard uncertainty [SI]."""
        from palpate_notebook.data_frames import budget_frame

        return budget_frame(self.document)

    def __repr__(self) -> str:
        values = ", ".join(f"{name} {value} {value.verdict}".rstrip() for name, value in self.parameters.items())
        return f"<{self.name}: {values}>"


def _number(entry: Any) -> float:
    """Return a number of result.json; NaN for null."""
    return math.nan if entry is None else float(entry)


def _contributions(budget_rows: Any, name: str) -> dict[str, float]:
    """Return the standard uncertainty of a value by source, without sources that contribute nothing."""
    contributions = {}
    for row in budget_rows:
        effect = row["effects"].get(name)
        if effect and effect["contribution"]:
            contributions[row["source"]] = effect["contribution"]
    return contributions
