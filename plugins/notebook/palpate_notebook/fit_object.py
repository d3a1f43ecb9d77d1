"""A fit: one model on one record."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from palpate import Flag, Floats

from palpate_notebook.figure_object import Picture
from palpate_notebook.quantity import UncertainQuantity
from palpate_notebook.run_object import FinishedRun
from palpate_notebook.suggestions import with_suggestions
from palpate_notebook.track_object import TrackView

if TYPE_CHECKING:
    import pandas


@with_suggestions
class Fit:
    """Fit of one model to one record."""

    def __init__(self, run: FinishedRun) -> None:
        self.run = run  # with everything else that a run gives
        self.track: TrackView = run[next(iter(run))]

    @property
    def parameters(self) -> dict[str, UncertainQuantity]:
        """The model's parameters, then the values that follow from them, by name."""
        return self.track.parameters

    def __getitem__(self, name: str) -> UncertainQuantity:
        return self.track[name]

    @property
    def elasticity(self) -> UncertainQuantity:
        """Young's modulus [Pa]; raises ConfigurationError where the model does not give it."""
        return self.track.elasticity

    @property
    def viscosity(self) -> UncertainQuantity:
        """The material's viscosity [Pa s]; raises ConfigurationError where the model does not give it."""
        return self.track.viscosity

    @property
    def surface(self) -> UncertainQuantity:
        """Height of the untouched surface [m]."""
        return self.track.surface

    @property
    def flags(self) -> tuple[Flag, ...]:
        """The flags on the fit."""
        return self.track.flags

    @property
    def verdict(self) -> str:
        """The verdict on the elasticity; for a model without one the worst of the verdicts on its values."""
        return self.track.verdict

    @property
    def residual(self) -> float:
        """Root mean square of measured less modelled force [N]."""
        return self.track.residual

    @property
    def prediction(self) -> float:
        """Relative error of the force that a fit of one half predicts for the other; NaN if that was not tested."""
        table = self.track.document.get("diagnoses", {}).get("model-discrepancy", {}).get("prediction", {})
        return float(table.get("error", math.nan))

    @property
    def force(self) -> Floats:
        """The model's contact force (n,) [N] at each sample; NaN at samples that were not fitted."""
        return self.run.track_tables[self.track.name].others["force"]

    @property
    def residuals(self) -> Floats:
        """Measured less modelled contact force (n,) [N] at each sample; NaN at samples that were not fitted."""
        return self.run.contact_force - self.force

    @property
    def frame(self) -> pandas.DataFrame:
        """A row for each sample [SI]: motion, force of the sensor, contact force, the model's, and the residual."""
        from palpate_notebook.data_frames import fit_frame

        return fit_frame(self.run.aligned, self.run.contact_force, self.force)

    def to_dict(self) -> dict[str, str | float]:
        """Return the row of ``fits.csv`` [SI]: values, uncertainties, verdicts, codes of flags."""
        row: dict[str, str | float] = {"curve": self.run.name, "track": self.track.name}
        for name, quantity in {**self.parameters, "surface": self.surface}.items():
            row[name] = quantity.value
            row[f"{name}_std"] = quantity.std
            row[f"{name}_combined"] = quantity.combined
        for name, quantity in self.parameters.items():
            row[f"{name}_verdict"] = quantity.verdict
        row["rms"] = self.residual
        row["prediction"] = self.prediction
        row["samples"] = int(np.isfinite(self.force).sum())
        row["verdict"] = self.verdict
        row["flags"] = " ".join(flag.code for flag in self.flags)
        return row

    def summary(self, si: bool = False) -> pandas.DataFrame:
        """Return a row for each parameter: value, std, combined, unit; in display units, or SI."""
        return self.run.summary(si).loc[self.track.name]

    def budget(self) -> pandas.DataFrame:
        """Return every source of uncertainty with its contribution to each value, as a standard uncertainty [SI]."""
        return self.track.budget()

    @property
    def correlation(self) -> pandas.DataFrame:
        """Correlation matrix of all unknowns of the fit, the height of the surface among them."""
        from palpate_notebook.data_frames import correlation_frame

        return correlation_frame(self.track.document)

    def plot(self) -> Picture:
        """Return a picture of measured and modelled force over time and over depth, and of the residual."""
        from palpate_notebook.plotting import fit_picture

        return fit_picture(self.run, self.track.name)

    def __repr__(self) -> str:
        return repr(self.run)

    def _repr_html_(self) -> str:
        return self.run._repr_html_()
