"""The relaxation modulus of a linear material."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class RelaxationSpectrum:
    """A relaxation modulus E(t) = E + sum of E_k exp(-t/tau_k), and a damper in parallel."""

    lasting: Any  # E [Pa]; None: nothing lasts
    damper: Any  # shear viscosity [Pa s]; None: no damper
    arms: tuple[tuple[Any, Any], ...]  # E_k [Pa], 1/tau_k [1/s]
