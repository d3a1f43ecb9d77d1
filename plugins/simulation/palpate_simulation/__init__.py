"""Simulation: a rig over a specimen, the twins of real rigs, and rehearsals."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate import Command, plugin
from palpate_kit.lazy_names import lazy_names

if TYPE_CHECKING:
    from palpate_simulation.simulated_rig import SimulatedRig as SimulatedRig
    from palpate_simulation.twins.bench import VirtualBench as VirtualBench


@plugin
def palpate_devices() -> dict[str, str]:
    """Return a simulated rig."""
    return {"sim": "palpate_simulation.simulated_rig:SimulatedRig"}


@plugin
def palpate_twins() -> dict[str, str]:
    """Robots and sensors in software that use the protocols of the real ones."""
    return {"ur3e-bota": "palpate_simulation.twins.bench:VirtualBench"}


@plugin
def palpate_commands() -> dict[str, Command]:
    """Return a run without its rig."""
    target = "palpate_simulation.rehearse:rehearse"
    return {"rehearse": Command(target, "Run the pipeline of a robot in simulated time.", "hardware")}


__getattr__, __all__ = lazy_names(__name__, *palpate_devices().values(), *palpate_twins().values())
