"""Devices and sinks: the outside world."""

from palpate import Device, Sink, plugin

from palpate_devices.csv_replay import CsvReplay
from palpate_devices.csv_sink import CsvSink
from palpate_devices.mcap_replay import McapReplay
from palpate_devices.mcap_sink import McapSink
from palpate_devices.sim import SimulatedRig


@plugin
def palpate_devices() -> dict[str, type[Device]]:
    """Robots, sensors, simulated rigs and logs."""
    return {"sim": SimulatedRig, "csv-replay": CsvReplay, "mcap-replay": McapReplay}


@plugin
def palpate_sinks() -> dict[str, type[Sink]]:
    """Places to write to."""
    return {"mcap": McapSink, "csv": CsvSink}
