"""Arms of Franka Robotics for palpate: an arm whose controller gives way to a force."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate import Command, plugin

if TYPE_CHECKING:
    from palpate import Device, Twin


@plugin
def palpate_devices() -> dict[str, type[Device] | str]:
    """Return the arm."""
    return {"franka": "palpate_franka.device:Franka"}


@plugin
def palpate_twins() -> dict[str, type[Twin] | str]:
    """Return the simulated arm with its sensor."""
    return {"franka-bota": "palpate_franka.twin:FrankaBench"}


@plugin
def palpate_commands() -> dict[str, Command]:
    """Return the command that only a person may give."""
    return {
        "franka-recover": Command(
            "palpate_franka.recover:recover", "Recover a Franka from a reflex, once a person has freed it.", "hardware"
        )
    }


PALPATE_API = 1  # number of the interface for which it is written
