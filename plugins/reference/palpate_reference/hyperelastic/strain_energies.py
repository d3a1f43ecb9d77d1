"""Strain energies of incompressible solids, and the stress that each gives in tension, compression and simple shear."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

# Range of the stretches that are examined, and how many each way: choices beyond what soft solids bear.
_MIN_STRETCH, _MAX_STRETCH = 0.2, 5.0
_STRETCHES = 400
Stress = Callable[[Floats, Sequence[float]], Floats]  # of stretches or shears (n,) and parameters


@dataclass(frozen=True)
class HyperelasticLaw:
    """A strain energy W of incompressible solids."""

    name: str
    formula: str
    parameters: tuple[tuple[str, str], ...]  # name and SI unit
    uniaxial: Stress  # nominal stress (n,) [Pa] at stretches (n,)
    shear: Stress  # shear stress (n,) [Pa] at amounts of shear (n,)
    shear_modulus: Callable[[Sequence[float]], float]  # at small strain [Pa]
    starts: Callable[[float], list[list[float]]]  # from a shear modulus [Pa]


def _drive(stretch: Floats) -> Floats:
    """Return l - l^-2, the nominal stress of a neo-Hookean solid over its shear modulus."""
    return stretch - stretch**-2


def _yeoh(i1: Floats, p: Sequence[float]) -> Floats:
    """Return dW/dI_1 [Pa] of I_1 - 3."""
    return p[0] + 2.0 * p[1] * i1 + 3.0 * p[2] * i1**2


def _ogden_shear(shear: Floats, p: Sequence[float]) -> Floats:
    """Return the stress by the principal stretches s and 1/s of a simple shear s - 1/s (Ogden 1984, 2.2)."""
    s = 0.5 * shear + np.sqrt(1.0 + 0.25 * shear**2)
    return 2.0 * p[0] / p[1] * (s ** p[1] - s ** -p[1]) / (s + 1.0 / s)


HYPERELASTIC = (
    HyperelasticLaw(
        "neo-hookean", "W = G/2 (I_1 - 3)", (("shear_modulus", "Pa"),),
        lambda stretch, p: p[0] * _drive(stretch), lambda shear, p: p[0] * shear, lambda p: p[0], lambda g: [[g]],
    ),
    HyperelasticLaw(
        "mooney-rivlin", "W = C10 (I_1 - 3) + C01 (I_2 - 3)", (("C10", "Pa"), ("C01", "Pa")),
        lambda stretch, p: 2.0 * (p[0] + p[1] / stretch) * _drive(stretch),
        lambda shear, p: 2.0 * (p[0] + p[1]) * shear,
        lambda p: 2.0 * (p[0] + p[1]), lambda g: [[0.3 * g, 0.2 * g]],
    ),
    HyperelasticLaw(
        "yeoh", "W = C10 (I_1 - 3) + C20 (I_1 - 3)^2 + C30 (I_1 - 3)^3", (("C10", "Pa"), ("C20", "Pa"), ("C30", "Pa")),
        lambda stretch, p: 2.0 * _drive(stretch) * _yeoh(stretch**2 + 2.0 / stretch - 3.0, p),
        lambda shear, p: 2.0 * shear * _yeoh(shear**2, p), lambda p: 2.0 * p[0], lambda g: [[0.5 * g, 0.0, 0.0]],
    ),
    HyperelasticLaw(
        "ogden", "W = 2 mu/alpha^2 (l_1^alpha + l_2^alpha + l_3^alpha - 3)", (("mu", "Pa"), ("alpha", "1")),
        lambda stretch, p: 2.0 * p[0] / p[1] * (stretch ** (p[1] - 1.0) - stretch ** (-0.5 * p[1] - 1.0)), _ogden_shear,
        lambda p: p[0], lambda g: [[g, alpha] for alpha in (2.0, 8.0, -4.0)],
    ),
)  # fmt: skip


def energy_of(name: str) -> HyperelasticLaw | None:
    """Return the law of a name, if there is one."""
    return next((law for law in HYPERELASTIC if law.name == name), None)


def stable_stretches(law: HyperelasticLaw, values: Sequence[float]) -> tuple[float, float]:
    """Return the stretches around 1 between which the nominal stress of tension and compression rises.

    At most 0.2 to 5, in 400 steps each way. A program of finite elements needs it in order to converge (Drucker's
    condition in one direction).
    """
    below_one = np.geomspace(_MIN_STRETCH, 1.0, _STRETCHES)
    above_one = np.geomspace(1.0, _MAX_STRETCH, _STRETCHES)[1:]
    stretch = np.concatenate([below_one, above_one])
    with np.errstate(over="ignore", invalid="ignore"):
        rises = np.diff(law.uniaxial(stretch, values)) > 0.0  # from each stretch to the next
    middle = _STRETCHES - 1  # index of the stretch 1
    low_steps = _leading_count(rises[:middle][::-1])
    high_steps = _leading_count(rises[middle:])
    return float(stretch[middle - low_steps]), float(stretch[middle + high_steps])


def _leading_count(flags: NDArray[np.bool_]) -> int:
    """Return how many flags (n,) are True before the first that is not."""
    return len(flags) if flags.all() else int(np.argmin(flags))
