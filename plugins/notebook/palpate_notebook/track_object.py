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
    """What one contact model with one estimator found."""

    def __init__(self, name: str, document: Mapping[str, Any], estimates: Callable[[], xarray.Dataset]) -> None:
        self.name, self.document = name, document
        self._estimates = estimates  # of all tracks; keeps the run and its folder

    @property
    def parameters(self) -> dict[str, UncertainQuantity]:
        """The model's parameters, then what follows from them, by name."""
        rows = self.document.get("budget", ())
        found = {
            name: UncertainQuantity.of(name, table, _shares(rows, name))
            for name, table in self.document["parameters"].items()
        }
        return found | {
            name: UncertainQuantity.of(name, table) for name, table in self.document.get("derived", {}).items()
        }

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
        """The verdict of its elasticity; of a model without one the worst of its values with a number."""
        return str(self.document["verdict"])

    @property
    def flags(self) -> tuple[Flag, ...]:
        """Its flags, those of the whole record among them."""
        return read_flags(self.document["flags"])

    @property
    def residual(self) -> float:
        """Root mean square of measured less modelled force [N]."""
        return _number(self.document["force_rms"])

    @property
    def nis(self) -> float:
        """Mean normalised innovation squared; 1 where model and noise are right."""
        return _number(self.document["nis"])

    @property
    def estimates(self) -> xarray.Dataset:
        """The estimates over time; dimension time, units in the attributes."""
        return self._estimates().sel(track=self.name)

    def budget(self) -> pandas.DataFrame:
        """Return every source of uncertainty, and the standard uncertainty that it gives each value [SI]."""
        from palpate_notebook.data_frames import budget_frame

        return budget_frame(self.document)

    def __repr__(self) -> str:
        values = ", ".join(f"{name} {value} {value.verdict}".rstrip() for name, value in self.parameters.items())
        return f"<{self.name}: {values}>"


def _number(value: Any) -> float:
    return math.nan if value is None else float(value)


def _shares(rows: Any, name: str) -> dict[str, float]:
    effects = {row["source"]: row["effects"].get(name) for row in rows}
    return {source: effect["contribution"] for source, effect in effects.items() if effect and effect["contribution"]}
