"""First guess of a model that sticks: its force is in proportion to modulus and work of adhesion together only."""

from __future__ import annotations

import numpy as np
from palpate import ContactModel, Floats
from palpate_kit.numerics.refusal import NotFitted
from palpate_kit.numerics.variable_projection import LinearPart, best_place, linear_part

from palpate_fits.record_arrays import FitRecord
from palpate_fits.residual import reading
from palpate_fits.unknowns import Unknowns

_RATIOS = np.geomspace(1e-12, 1e-2, 21)  # [m] of work of adhesion over modulus
_HEIGHTS = np.linspace(0.0, 1.0, 41)[1:]  # of the surface within the record, as shares of its range from the bottom
_FEW, _WHOLE = 500, 20_000  # samples, of the last two grids
_LAST = 2


def adhesive_guess(model: ContactModel, unknowns: Unknowns, whole: FitRecord) -> Floats:
    """Values (P,) to start from; raises NotFitted where nothing fits.

    At every height of the surface and every ratio of work to modulus the force of E = 1 Pa is a column, as are bias and
    slope where they are free. The last grids are of the whole record: the force jumps where the tip touches, so that
    the solvers cannot pass a sample.
    """
    low, reach = float(whole.height.min()), float(np.ptp(whole.height))
    surface, own = unknowns.index("surface"), slice(0, len(model.parameters))
    skin = unknowns.items[surface]
    extras = [unknowns.index(name) for name in ("bias", "slope") if unknowns.items[unknowns.index(name)].free]
    base = np.array([0.0 if item.value is None else item.value for item in unknowns.items])
    base[extras] = 0.0
    thin = whole.thinned(_FEW), whole.thinned(_WHOLE)

    def values(ratio: float, height: float) -> Floats:
        x = base.copy()
        x[own], x[surface] = (1.0, ratio), height
        return x

    def at(ratio: float, height: float, left: int) -> LinearPart:
        record = thin[left < _LAST]
        rest, force = (
            np.asarray(reading(model, values(ratio, z).tolist(), list(record.parts), record.transition), float)
            for z in (low - reach, height)  # what is read without contact, and with it
        )
        others = {"bias": np.ones(len(record)), "slope": record.time}
        columns = np.column_stack([force - rest, *(others[unknowns.names[place]] for place in extras)])
        return linear_part(record.weight[:, None] * columns, record.weight * (record.force - rest))

    heights = low + reach * _HEIGHTS if skin.value is None else np.array([skin.value])
    heights = np.clip(heights, skin.lower, skin.upper)
    held = skin.value is not None

    def squares(ratio: float, height: float, left: int) -> float:
        found = at(ratio, height, left)
        return found.squares if found.unknowns[0] > 0 else np.inf

    ratio, height = best_place(squares, _RATIOS, heights, held=held)
    found = at(ratio, height, 0)
    if not (np.isfinite(found.squares) and found.unknowns[0] > 0):
        raise NotFitted("not-fitted", "no start was found at which the model gives a finite force")
    x = values(ratio, height)
    x[own] *= found.unknowns[0]
    x[extras] = found.unknowns[1:]
    return np.array([item.inside(value) for item, value in zip(unknowns.items, x.tolist(), strict=True)])
