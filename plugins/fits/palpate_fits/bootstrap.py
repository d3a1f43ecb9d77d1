"""Block bootstrap: fits to data made of the fit and its own residuals, drawn in blocks that keep their correlation."""

from __future__ import annotations

from typing import Any

import numpy as np
from palpate import Floats

from palpate_fits.loss import LossFunction
from palpate_fits.record_arrays import FitRecord
from palpate_fits.residual import Residual
from palpate_fits.solvers import descend
from palpate_fits.unknowns import Unknowns

_BLOCK_TIMES = 10.0  # correlation times of a block, beyond which residuals are independent (choice)
_MIN_BLOCKS = 4  # of a record (choice)


def block_bootstrap(
    residual: Residual,
    unknowns: Unknowns,
    record: FitRecord,
    x: Floats,
    loss: LossFunction,
    correlation_time: float,
    repeats: int,
    seed: int,
    confidence: float,
) -> dict[str, Any]:
    """Return standard deviation and percentile interval of each free unknown over refits, as ``result.json`` has them.

    x (P,) is the minimum, the correlation time that of its residuals [samples]. Each refit is of the model's force less
    residuals that are drawn in circular blocks (Politis and Romano 1992). A refit that has not converged counts with
    the values at which it ended.
    """
    random = np.random.default_rng(seed)
    used = np.flatnonzero(record.used)
    # Model less measured force [N], and the force of the model; the residual of a fit has the weights of the samples.
    error = residual.whole(record, x)[0][used] / record.weight[used]
    model_force = record.force.copy()
    model_force[used] += error
    centred = error - error.mean()
    block_length = _block_length(len(centred), correlation_time)
    # A fit to each force that is drawn.
    estimates = np.empty((repeats, len(residual.free)))
    for repeat in range(repeats):
        force = model_force.copy()
        force[used] -= _draw_blocks(centred, block_length, random)
        solution = descend(residual, unknowns, record.with_force(force), x, loss)
        estimates[repeat] = solution.x[list(residual.free)]
    names = [unknowns.names[place] for place in residual.free]
    table = {}
    for name, values in zip(names, estimates.T, strict=True):
        table[name] = _spread(values, confidence)
    return {"repeats": repeats, "block": block_length, "seed": seed, "unknowns": table}


def _draw_blocks(residuals: Floats, block_length: int, random: np.random.Generator) -> Floats:
    """Return residuals (n,) in blocks from random starts, around the end of the record, as many as give n of them."""
    n = len(residuals)
    starts = random.integers(0, n, -(-n // block_length))
    rows = (starts[:, None] + np.arange(block_length)).ravel()[:n] % n
    return np.asarray(residuals[rows])


def _spread(estimates: Floats, confidence: float) -> dict[str, Any]:
    """Return the standard deviation of estimates (repeats,), and the interval of a confidence about their median."""
    tail = 50.0 * (1.0 - confidence)  # [%] on each side
    low, high = np.percentile(estimates, [tail, 100.0 - tail])
    return {"std": float(estimates.std(ddof=1)), "interval": [float(low), float(high)]}


def _block_length(count: int, correlation_time: float) -> int:
    """Return the samples of a block: n^(1/3), or 10 correlation times where these are longer; a quarter at most."""
    length = np.ceil(max(count ** (1 / 3), _BLOCK_TIMES * correlation_time))
    return int(np.clip(length, 1, max(count // _MIN_BLOCKS, 1)))
