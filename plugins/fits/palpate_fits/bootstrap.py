"""Block bootstrap: fits to data made of the fit and its own residuals, drawn in blocks that keep their correlation."""

from __future__ import annotations

from typing import Any

import numpy as np
from palpate import Floats

from palpate_fits.loss import LossFunction
from palpate_fits.record_arrays import FitRecord
from palpate_fits.residual import Residual
from palpate_fits.solvers import descend
from palpate_fits.uncertainty import ResidualScatter
from palpate_fits.unknowns import Unknowns


def block_bootstrap(
    residual: Residual,
    unknowns: Unknowns,
    record: FitRecord,
    x: Floats,
    loss: LossFunction,
    found: ResidualScatter,
    repeats: int,
    seed: int,
    confidence: float,
) -> dict[str, Any]:
    """Standard deviation and percentile interval of each free unknown over refits (circular blocks; Politis 1992)."""
    random = np.random.default_rng(seed)
    error = residual.whole(record, x)[0]
    used = np.flatnonzero(record.used)
    left = error[used] / record.weight[used]
    left = left - left.mean()
    length = int(np.clip(np.ceil(max(len(left) ** (1 / 3), 10.0 * found.correlation_time)), 1, max(len(left) // 4, 1)))
    expected = record.force.copy()
    expected[used] += error[used] / record.weight[used]
    values = np.empty((repeats, len(residual.free)))
    for repeat in range(repeats):
        starts = random.integers(0, len(left), -(-len(left) // length))
        drawn = left[(starts[:, None] + np.arange(length)).ravel()[: len(left)] % len(left)]
        force = expected.copy()
        force[used] -= drawn
        solution = descend(residual, unknowns, record.with_force(force), x, loss)
        values[repeat] = solution.x[list(residual.free)]
    tail = 50.0 * (1.0 - confidence)
    table = {}
    for column, place in enumerate(residual.free):
        low, high = np.percentile(values[:, column], [tail, 100.0 - tail])
        name = unknowns.names[place]
        table[name] = {"std": float(values[:, column].std(ddof=1)), "interval": [float(low), float(high)]}
    return {"repeats": repeats, "block": length, "seed": seed, "unknowns": table}
