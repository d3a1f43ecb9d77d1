"""Weak forms of a neo-Hookean or Fung, nearly incompressible, axisymmetric body, from the reference, over 2 pi.

Energy density E/(6 b) (exp(b i) - 1) + p (J - 1) - p^2/(2 k), i = I_1 - 3 - 2 ln J; b = 0 is the neo-Hookean E/6 i.
`w.u` is the displacement so far, `w.p` the pressure, `w.b` the stiffening b, `w.modulus` E over the unit of forces.
"""

from __future__ import annotations

from typing import Any

import numpy as np

MODULUS = 1.0  # Young's modulus; forces are per it
BULK = 1e5  # of the modulus, a choice: Poisson's ratio 0.499998
_MIN_VOLUME = 1e-6  # of the volume at rest, a choice: a trial step with less is not taken, but needs a logarithm


def gradient(u: Any, r: Any) -> Any:
    """Return the gradient (3, 3, ...) of an axisymmetric displacement: r, z and around."""
    result = np.zeros((3, 3, *u.grad.shape[2:]))
    for i in range(2):
        for j in range(2):
            result[i, j] = u.grad[i, j]
    result[2, 2] = u[0] / r
    return result


def _deformed(w: Any) -> tuple[Any, Any, Any]:
    """Return F^-T, J and F of the present displacement; 3 by 3 with a block of 2, in closed form."""
    F = gradient(w.u, w.x[0])
    for i in range(3):
        F[i, i] += 1.0
    plane = F[0, 0] * F[1, 1] - F[0, 1] * F[1, 0]
    inverse = np.zeros_like(F)
    inverse[0, 0] = F[1, 1] / plane
    inverse[1, 1] = F[0, 0] / plane
    inverse[0, 1] = -F[1, 0] / plane
    inverse[1, 0] = -F[0, 1] / plane
    inverse[2, 2] = 1.0 / F[2, 2]
    return inverse, plane * F[2, 2], F


def _inner(a: Any, b: Any) -> Any:
    return np.einsum("ij...,ij...", a, b)


def _shear(w: Any, volume: Any, F: Any) -> Any:
    """Return the shear modulus at the present stretch, E/3 exp(b i)."""
    shear = MODULUS / 3 * w.modulus
    if not w.b:
        return shear
    return shear * np.exp(w.b * (_inner(F, F) - 3 - 2 * np.log(np.maximum(volume, _MIN_VOLUME))))


def stress(v: Any, w: Any) -> Any:
    """Return the work of the stress, mu (F - F^-T) + p J F^-T, on a virtual displacement."""
    inverse, volume, F = _deformed(w)
    stress = _shear(w, volume, F) * (F - inverse) + w.p * volume * inverse
    return _inner(stress, gradient(v, w.x[0])) * w.x[0]


def stiffness(u: Any, v: Any, w: Any) -> Any:
    """Return the derivative of the stress's work by the displacement."""
    inverse, volume, F = _deformed(w)
    du, dv = gradient(u, w.x[0]), gradient(v, w.x[0])
    # d(F^-T) = -F^-T du^T F^-T.
    change = np.einsum("ij...,kj...,kl...->il...", inverse, du, inverse)
    stretch = F - inverse
    shear = _inner(du, dv) + _inner(change, dv) + 2 * w.b * _inner(stretch, du) * _inner(stretch, dv)
    pressure = w.p * volume * (_inner(inverse, du) * _inner(inverse, dv) - _inner(change, dv))
    return (_shear(w, volume, F) * shear + pressure) * w.x[0]


def coupling(p: Any, v: Any, w: Any) -> Any:
    """Return the work of a pressure on a virtual displacement."""
    inverse, volume, _ = _deformed(w)
    return p * volume * _inner(inverse, gradient(v, w.x[0])) * w.x[0]


def softness(p: Any, q: Any, w: Any) -> Any:
    """Return the change of volume by a pressure, -p/k."""
    return -p * q / (BULK * MODULUS) * w.x[0]


def volume(q: Any, w: Any) -> Any:
    """Return the volume gained beyond that by the pressure, J - 1 - p/k."""
    return q * (_deformed(w)[1] - 1.0 - w.p / (BULK * MODULUS)) * w.x[0]
