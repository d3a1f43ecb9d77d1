"""The latest state of an arm, as every check of a command looks at it."""

from __future__ import annotations

from dataclasses import dataclass

from palpate import Floats


@dataclass(frozen=True)
class ArmState:
    """The robot's last state, in the work frame; its joints in their own."""

    position: Floats  # (3,)
    velocity: Floats  # (3,)
    rotation: Floats  # (3, 3) in the base
    q: list[float]  # (n,) [rad]
    fresh: bool  # said since the last period
