"""What a record can tell at best: the Cramer-Rao bound of a track's parameters."""

from __future__ import annotations

import numpy as np

from palpate.contact import ContactModel, force_slopes
from palpate.result.record import Tail
from palpate.vectors import Floats


def told_at_best(tail: Tail, model: ContactModel, noise: float, samples: int) -> Floats:
    """Least standard uncertainties (k,) by any estimator, for white noise [N] and an unknown surface.

    The bound is noise^2 (J^T J)^-1, J the slopes of the force in parameters and depth along the tail, which stands for
    all of the `samples`. Not finite where the tail or the estimate says nothing, and for a model with memory.
    """
    nothing = np.full(len(model.parameters), np.inf)
    theta, depth, rate = tail.values[-1], float(tail.surface[-1]) - tail.position, -tail.velocity
    rows = np.isfinite(depth) & np.isfinite(rate) & (depth > 0)
    if model.memory or not rows.any() or not np.isfinite(theta).all():
        return nothing
    _, by_parameter, by_depth, _ = force_slopes(model, depth[rows], rate[rows], theta.tolist())
    slopes = np.column_stack([by_parameter, by_depth])
    lengths = np.linalg.norm(slopes, axis=0)
    if not (np.isfinite(slopes).all() and (lengths > 0).all()):
        return nothing
    inverse = np.linalg.pinv((slopes / lengths).T @ (slopes / lengths), hermitian=True)
    share = samples / len(tail.time)
    return np.asarray(noise * np.sqrt(np.maximum(np.diag(inverse), 0.0) / share) / lengths)[:-1]
