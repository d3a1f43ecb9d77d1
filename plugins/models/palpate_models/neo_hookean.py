"""Weak forms of a neo-Hookean or Fung, nearly incompressible, axisymmetric body, from the reference, over 2 pi.

Energy density E/(6 b) (exp(b i) - 1) + p (J - 1) - p^2/(2 k), i = I_1 - 3 - 2 ln J; b = 0 is the neo-Hookean E/6 i.
`w.u` is the displacement so far, `w.p` the pressure, `w.b` the stiffening b, `w.modulus` E over the unit of forces.
"""

from __future__ import annotations

from typing import Any

import numpy as np

MODULUS = 1.0  # Young's modulus; forces are per it
_LEAST = 1e-6  # of the volume, on a step that is not taken
BULK = 1e5  # of the modulus: Poisson's ratio 0.499998


def gradient(u: Any, r: Any) -> Any:
    """(3, 3, ...) gradient of an axisymmetric displacement: r, z and around."""
    found = np.zeros((3, 3, *u.grad.shape[2:]))
    for i in range(2):
        for j in range(2):
            found[i, j] = u.grad[i, j]
    found[2, 2] = u[0] / r
    return found


def _deformed(w: Any) -> tuple[Any, Any, Any]:
    """F^-T, J and F of the present displacement; 3 by 3 with a block of 2, in closed form."""
    F = gradient(w.u, w.x[0])
    for i in range(3):
        F[i, i] += 1.0
    plane = F[0, 0] * F[1, 1] - F[0, 1] * F[1, 0]
    inverse = np.zeros_like(F)
    inverse[0, 0], inverse[1, 1] = F[1, 1] / plane, F[0, 0] / plane
    inverse[0, 1], inverse[1, 0] = -F[1, 0] / plane, -F[0, 1] / plane
    inverse[2, 2] = 1.0 / F[2, 2]
    return inverse, plane * F[2, 2], F


def _inner(a: Any, b: Any) -> Any:
    return np.einsum("ij...,ij...", a, b)


def _shear(w: Any, volume: Any, F: Any) -> Any:
    """Shear modulus at the present stretch."""
    shear = MODULUS / 3 * w.modulus
    return shear * np.exp(w.b * (_inner(F, F) - 3 - 2 * np.log(np.maximum(volume, _LEAST)))) if w.b else shear


def stress(v: Any, w: Any) -> Any:
    """Work of the stress on a virtual displacement."""
    inverse, volume, F = _deformed(w)
    stress = _shear(w, volume, F) * (F - inverse) + w.p * volume * inverse
    return _inner(stress, gradient(v, w.x[0])) * w.x[0]


def stiffness(u: Any, v: Any, w: Any) -> Any:
    """Derivative of the stress's work by the displacement."""
    inverse, volume, F = _deformed(w)
    du, dv = gradient(u, w.x[0]), gradient(v, w.x[0])
    turned = np.einsum("ij...,kj...,kl...->il...", inverse, du, inverse)
    stretch = F - inverse
    found = _inner(du, dv) + _inner(turned, dv) + 2 * w.b * _inner(stretch, du) * _inner(stretch, dv)
    found = _shear(w, volume, F) * found
    found = found + w.p * volume * (_inner(inverse, du) * _inner(inverse, dv) - _inner(turned, dv))
    return found * w.x[0]


def coupling(p: Any, v: Any, w: Any) -> Any:
    """Work of a pressure on a virtual displacement."""
    inverse, volume, _ = _deformed(w)
    return p * volume * _inner(inverse, gradient(v, w.x[0])) * w.x[0]


def softness(p: Any, q: Any, w: Any) -> Any:
    """What pressure does to volume."""
    return -p * q / (BULK * MODULUS) * w.x[0]


def volume(q: Any, w: Any) -> Any:
    """Volume that is gained beyond what the pressure allows."""
    return q * (_deformed(w)[1] - 1.0 - w.p / (BULK * MODULUS)) * w.x[0]
