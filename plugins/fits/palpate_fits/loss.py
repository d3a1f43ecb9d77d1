"""Losses: how much a residual counts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from palpate import Floats

_MIN_SIZE = 1e-9  # |r|/s in place of 0, of which the slope of the root of the loss has no value (choice)


@dataclass(frozen=True)
class LossFunction:
    """rho(r): r^2 ("linear"), Huber's, or soft-L1 2 s^2 (sqrt(1 + (r/s)^2) - 1), with a scale s [N]."""

    kind: Literal["linear", "huber", "soft-l1"] = "linear"
    scale: float = 1.0

    def scaled(self, values: Floats) -> Floats:
        """Return [sign(r) sqrt(rho), its Jacobian] (n, 1 + p) of values [r, J]: the plain sum of squares is the loss.

        The Jacobian is rho'(r)/(2 sqrt(rho)) J.
        """
        if self.kind == "linear":
            return values
        residual = values[:, 0]
        size = np.maximum(np.abs(residual) / self.scale, _MIN_SIZE)
        root = self.scale * np.sqrt(self._rho(size))
        slope = self._slope(size) * size * self.scale / root
        return np.column_stack([np.sign(residual) * root, slope[:, None] * values[:, 1:]])

    def _rho(self, size: Floats) -> Floats:
        """Return rho/s^2 (n,) at sizes |r|/s."""
        if self.kind == "huber":
            return np.asarray(np.where(size <= 1, size**2, 2 * size - 1))
        return np.asarray(2.0 * size**2 / (np.sqrt(1 + size**2) + 1))  # 2 (sqrt(1 + z^2) - 1) without cancellation

    def _slope(self, size: Floats) -> Floats:
        """Return rho'(r)/(2 r) (n,) at sizes |r|/s."""
        if self.kind == "huber":
            return np.asarray(np.where(size <= 1, 1.0, 1.0 / size))
        if self.kind == "soft-l1":
            return 1.0 / np.sqrt(1 + size**2)
        return np.ones_like(size)

    def influence(self, residual: Floats) -> tuple[Floats, Floats]:
        """Return psi = rho'/2 (n,) and its derivative (n,) at residuals (n,), for robust covariances."""
        size = np.abs(residual) / self.scale
        if self.kind == "huber":
            return residual * self._slope(size), np.where(size <= 1, 1.0, 0.0)
        if self.kind == "soft-l1":
            return residual * self._slope(size), (1 + size**2) ** -1.5
        return residual, np.ones_like(residual)
