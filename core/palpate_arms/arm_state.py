"""The latest state of an arm, as every check of a command uses it."""

from __future__ import annotations

from dataclasses import dataclass

from palpate import Floats


@dataclass(frozen=True)
class ArmState:
    """The robot's last state, in the work frame; its joints in their own."""

    position: Floats  # (3,) [m]
    velocity: Floats  # (3,) [m/s]
    rotation: Floats  # (3, 3) in the base
    q: list[float]  # (n,) [rad]
    fresh: bool  # arrived since the last period
