"""First guess of an adhesive model: its force is in proportion to modulus and work of adhesion together only."""

from __future__ import annotations

import numpy as np
from palpate import ContactModel, Floats
from palpate_kit.numerics.refusal import NotFitted
from palpate_kit.numerics.variable_projection import LinearPart, best_place, linear_part

from palpate_fits.record_arrays import FitRecord
from palpate_fits.residual import reading
from palpate_fits.unknowns import Unknowns

# Choices.
_RATIOS = np.geomspace(1e-12, 1e-2, 21)  # [m] of work of adhesion over modulus
_HEIGHTS = np.linspace(0.0, 1.0, 41)[1:]  # of the surface within the record, as shares of its range from the bottom
_THINNED_SAMPLES = 500  # of the record, on all grids but the last two
_FINAL_SAMPLES = 20_000  # of the record, on the last two grids
_FINAL_GRIDS = 2


def adhesive_guess(model: ContactModel, unknowns: Unknowns, record: FitRecord) -> Floats:
    """Return values (P,) of all parameters to start from; raises NotFitted where nothing fits.

    A grid of heights of the surface, and of ratios of the work of adhesion to the modulus, is refined in rounds. At
    each point the force is linear in the modulus, and in bias and slope where they are free: these are solved for. The
    last two grids take up to 20 000 samples: the force jumps where the tip touches, so that the solvers cannot pass a
    sample.
    """
    # The heights of the surface that are tried first: within the record, or the one that is held.
    surface = unknowns.items[unknowns.index("surface")]
    is_held = surface.value is not None
    lowest, span = float(record.height.min()), float(np.ptp(record.height))
    heights = lowest + span * _HEIGHTS if surface.value is None else np.array([surface.value])
    heights = np.clip(heights, surface.lower, surface.upper)
    scale = _ModulusScale(model, unknowns, lowest - span)  # a surface as far below the record touches nothing
    # Few samples of the record, and as many as the last grids take.
    thinned, final = record.thinned(_THINNED_SAMPLES), record.thinned(_FINAL_SAMPLES)

    def squares(ratio: float, height: float, grids_left: int) -> float:
        """Return the sum of squares at a point of a grid; infinite where the modulus would be negative."""
        solution = scale.solve(final if grids_left < _FINAL_GRIDS else thinned, ratio, height)
        return solution.squares if solution.unknowns[0] > 0 else np.inf

    # The best point, then the modulus, bias and slope by least squares there.
    ratio, height = best_place(squares, _RATIOS, heights, held=is_held)
    solution = scale.solve(final, ratio, height)
    if not (np.isfinite(solution.squares) and solution.unknowns[0] > 0):
        raise NotFitted("not-fitted", "no start was found at which the model gives a finite force")
    x = scale.parameters(ratio, height)
    x[: len(model.parameters)] *= solution.unknowns[0]
    x[scale.extras] = solution.unknowns[1:]
    return np.array([item.inside(value) for item, value in zip(unknowns.items, x.tolist(), strict=True)])


class _ModulusScale:
    """Least squares of the modulus, and of bias and slope where they are free, at a ratio and a surface.

    `no_contact` [m] is a height of the surface below all of the record.
    """

    def __init__(self, model: ContactModel, unknowns: Unknowns, no_contact: float) -> None:
        self._model, self._unknowns, self._no_contact = model, unknowns, no_contact
        self._surface = unknowns.index("surface")
        places = [unknowns.index(name) for name in ("bias", "slope")]
        self.extras = [place for place in places if unknowns.items[place].free]
        self._base = np.array([0.0 if item.value is None else item.value for item in unknowns.items])
        self._base[self.extras] = 0.0

    def parameters(self, ratio: float, height: float) -> Floats:
        """Return all parameters (P,) for a modulus of 1 Pa, a ratio [m] of work to modulus and a surface [m]."""
        x = self._base.copy()
        x[: len(self._model.parameters)] = 1.0, ratio
        x[self._surface] = height
        return x

    def solve(self, record: FitRecord, ratio: float, height: float) -> LinearPart:
        """Return the best modulus [Pa] and values of the extras."""
        without_contact, reading_at_1 = (self._reading(record, ratio, z) for z in (self._no_contact, height))
        extra_columns = {"bias": np.ones(len(record)), "slope": record.time}
        columns = [reading_at_1 - without_contact]
        columns += [extra_columns[self._unknowns.names[place]] for place in self.extras]
        weighted = record.weight[:, None] * np.column_stack(columns)
        return linear_part(weighted, record.weight * (record.force - without_contact))

    def _reading(self, record: FitRecord, ratio: float, height: float) -> Floats:
        """Return the expected reading (n,) [N]."""
        parameters = self.parameters(ratio, height).tolist()
        return np.asarray(reading(self._model, parameters, list(record.parts), record.transition), float)
