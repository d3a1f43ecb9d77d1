"""Simulation: a rig over a specimen, the twins of real rigs, and rehearsals."""

from __future__ import annotations

from typing import TYPE_CHECKING

import lazy_loader
from palpate import Command, plugin

if TYPE_CHECKING:
    from palpate_simulation.simulated_rig import SimulatedRig
    from palpate_simulation.twins.bench import VirtualBench

__getattr__, _, _ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "simulated_rig": ["SimulatedRig"],
        "twins.bench": ["VirtualBench"],
    },
)

__all__ = [
    "SimulatedRig",
    "VirtualBench",
]


@plugin
def palpate_devices() -> dict[str, str]:
    """A simulated rig."""
    return {"sim": "palpate_simulation.simulated_rig:SimulatedRig"}


@plugin
def palpate_twins() -> dict[str, str]:
    """Robots and sensors in software that use the protocols of the real ones."""
    return {"ur3e-bota": "palpate_simulation.twins.bench:VirtualBench"}


@plugin
def palpate_commands() -> dict[str, Command]:
    """A run without its rig."""
    target = "palpate_simulation.rehearse:rehearse"
    return {"rehearse": Command(target, "Run the pipeline of a robot in simulated time.", "hardware")}
