"""Prediction: how well the law, fitted to one half of a record, gives the force of the other half."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import Floats
from palpate_engine import Result
from palpate_kit.terminal.prediction_text import BLOCK, HALF, prediction_text

_SMALLEST_LENGTH = 1e-300  # of a column in a quotient, in place of 0: near the smallest double
BLOCKS = 20  # of a press (choice), of which every second one is fitted: each half sees all depths
FEWEST_SAMPLES = 100  # of a record (choice), below which a half determines nothing


@dataclass(frozen=True)
class Prediction:
    """The error of a predicted force."""

    error: float  # in parts of the mean force that is predicted, noise removed
    words: str  # which part predicts which

    def table(self) -> dict[str, Any]:
        """Return the prediction as in ``result.json``."""
        return {"error": self.error, "words": self.words}


def predict_other_half(
    jacobian: Floats, residual: Floats, force: Floats, noise_variance: float, oscillates: bool
) -> Prediction | None:
    """Return the error of the half of a record that was held out; None where a record is too short.

    `jacobian` (n, f) are the derivatives of the force by what is fitted, at the estimate of the whole record, and
    `residual` (n,) [N] what that leaves. The half that is fitted leaves r_A; one Gauss-Newton step to its own estimate,
    x = J_A^+ r_A, changes the residual of the other half to r_B - J_B x. Its mean square less that of the noise [N^2]
    is the error. An oscillation is split in its middle, a press in blocks.
    """
    n = len(residual)
    if n < FEWEST_SAMPLES or not jacobian.shape[1]:
        return None
    row = np.arange(n)
    # The first half of an oscillation, every second block of a press.
    fitted: NDArray[np.bool_] = row < n // 2 if oscillates else row * BLOCKS // n % 2 == 0
    # Columns of length 1, for least squares.
    scaled = jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), _SMALLEST_LENGTH)
    step = np.linalg.lstsq(scaled[fitted], residual[fitted], rcond=None)[0]
    prediction_error = residual[~fitted] - scaled[~fitted] @ step
    mean_force = float(np.mean(np.abs(force[~fitted])))
    if not mean_force > 0:
        return None
    excess = max(float(np.mean(prediction_error**2)) - noise_variance, 0.0)
    return Prediction(math.sqrt(excess) / mean_force, HALF if oscillates else BLOCK)


def prediction_lines(result: Result) -> list[str]:
    """Return one line for each model of a run that predicts a half of its record."""
    lines = dict[str, str]()
    has_several_models = len({track.model for track in result.tracks.values()}) > 1
    for track in result.tracks.values():
        if prediction := track.diagnoses.get("model-discrepancy", {}).get("prediction"):
            name = f"{track.model}: " if has_several_models else ""
            lines.setdefault(track.model, f"{name}{prediction_text(prediction['error'], prediction['words'])}")
    return list(lines.values())
