"""Devices: robots, sensors, and the logs of runs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate import Command, Fact, plugin
from palpate_kit.lazy_names import lazy_names

if TYPE_CHECKING:
    from palpate_devices.bota.device import BotaSensor as BotaSensor
    from palpate_devices.mcap_replay import McapReplay as McapReplay
    from palpate_devices.mcap_sink import McapSink as McapSink
    from palpate_devices.rdt.device import RdtSensor as RdtSensor
    from palpate_devices.ur.device import UR as UR


@plugin
def palpate_devices() -> dict[str, str]:
    """Return robots, force sensors and MCAP logs."""
    return {
        "ur": "palpate_devices.ur.device:UR",
        "ur3e": "palpate_devices.ur.device:UR",
        "bota": "palpate_devices.bota.device:BotaSensor",
        "rdt": "palpate_devices.rdt.device:RdtSensor",
        "mcap-replay": "palpate_devices.mcap_replay:McapReplay",
    }


@plugin
def palpate_commands() -> dict[str, Command]:
    """Return commands for what is done at a robot by hand."""
    text = "Find payload, tip and surface by leading the arm; nothing is moved."
    return {"calibrate teach": Command("palpate_devices.teach.teach_command:teach", text, "hardware")}


@plugin
def palpate_sinks() -> dict[str, str]:
    """Return the sink of MCAP logs."""
    return {"mcap": "palpate_devices.mcap_sink:McapSink"}


@plugin
def palpate_facts() -> dict[str, Fact]:
    """Return True if a robot can be driven from here."""
    return {"robots": Fact("palpate_devices.ur.client_library:robots_here")}


__getattr__, __all__ = lazy_names(__name__, *palpate_devices().values(), *palpate_sinks().values())
