"""Flags from the health that connected devices report."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from palpate.flags import Flag

from palpate_engine.alignment import AlignmentSettings, Ports

_MIN_PAYLOAD_SHARE = 0.9  # of the tip's mass, a choice; the payload has the sensor and its flange as well

Health = Mapping[str, Mapping[str, Any]]  # by device


def device_flags(alignment: AlignmentSettings, ports: Ports, live: Health | None) -> tuple[Flag, ...]:
    """Return the flags of devices: those of their health, with its messages; clocks that wander, payloads."""
    health = live or {}
    raised = (Flag(code, text) for facts in health.values() for code, text in facts.get("flags", {}).items())
    return (*raised, *_clocks(ports, health), *(Flag("payload", text) for text in payloads(alignment, health)))


def _clocks(ports: Ports, health: Health) -> Iterator[Flag]:
    """Yield a flag for each device whose clock strayed by more than the declared uncertainty of its time-stamps.

    `health` has the reports of the devices by their names.
    """
    flagged = set()
    for role in ("force", "position", "velocity"):
        if role not in ports.roles:
            continue
        port = ports[role]
        deviation, declared = health.get(port.device, {}).get("clock_deviation"), port.signal.uncertainty
        if deviation is None or declared is None or port.signal.time != "stamp" or port.device in flagged:
            continue
        if deviation > declared:
            flagged.add(port.device)
            yield Flag(
                "clock-wander",
                f"the clock of {port.device} strayed by {1e3 * deviation:.2f} ms from an even one; [alignment] {role} "
                f"uncertainty is {1e3 * declared:g} ms",
            )


def payloads(alignment: AlignmentSettings, health: Health) -> Iterator[str]:
    """Yield what is wrong with the payloads that arms have: less than the tip alone weighs."""
    for name, facts in health.items():
        payload = facts.get("payload")
        if payload is None or alignment.tip_mass is None or payload >= _MIN_PAYLOAD_SHARE * alignment.tip_mass:
            continue
        yield (
            f"{name} counts on a payload of {payload:.3g} kg, less than the tip's mass of {alignment.tip_mass:.3g} kg: "
            "its own force and its protective stops are off"
        )
