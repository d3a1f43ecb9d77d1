"""Devices: robots, sensors, and the logs of runs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import lazy_loader
from palpate import Command, Fact, plugin

if TYPE_CHECKING:
    from palpate_devices.bota.device import BotaSensor
    from palpate_devices.mcap_replay import McapReplay
    from palpate_devices.mcap_sink import McapSink
    from palpate_devices.rdt.device import RdtSensor
    from palpate_devices.ur.device import UR

__getattr__, _, _ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "bota.device": ["BotaSensor"],
        "mcap_replay": ["McapReplay"],
        "mcap_sink": ["McapSink"],
        "rdt.device": ["RdtSensor"],
        "ur.device": ["UR"],
    },
)

__all__ = [
    "UR",
    "BotaSensor",
    "McapReplay",
    "McapSink",
    "RdtSensor",
]


@plugin
def palpate_devices() -> dict[str, str]:
    """Robots, force sensors and MCAP logs."""
    return {
        "ur": "palpate_devices.ur.device:UR",
        "ur3e": "palpate_devices.ur.device:UR",
        "bota": "palpate_devices.bota.device:BotaSensor",
        "rdt": "palpate_devices.rdt.device:RdtSensor",
        "mcap-replay": "palpate_devices.mcap_replay:McapReplay",
    }


@plugin
def palpate_commands() -> dict[str, Command]:
    """What is done at a robot by hand."""
    text = "Find payload, tip and surface by leading the arm; nothing is moved."
    return {"calibrate teach": Command("palpate_devices.teach.teach_command:teach", text, "hardware")}


@plugin
def palpate_sinks() -> dict[str, str]:
    """MCAP logs."""
    return {"mcap": "palpate_devices.mcap_sink:McapSink"}


@plugin
def palpate_facts() -> dict[str, Fact]:
    """Whether a robot can be driven from here."""
    return {"robots": Fact("palpate_devices.ur.client_library:robots_here")}
