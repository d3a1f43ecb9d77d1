"""A force gauge with a position encoder, and its log."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate import plugin

if TYPE_CHECKING:
    from palpate import Device

PALPATE_API = 1


@plugin
def palpate_devices() -> dict[str, type[Device] | str]:
    """By name."""
    return {
        "gauge": "palpate_gauge.sensor:Gauge",
        "gauge-log": "palpate_gauge.log:GaugeLog",
    }
