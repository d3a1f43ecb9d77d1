"""Devices and sinks: the outside world."""

from palpate import Device, Sink, plugin

from palpate_devices.csv_replay import CsvReplay
from palpate_devices.csv_sink import CsvSink
from palpate_devices.mcap_replay import McapReplay
from palpate_devices.mcap_sink import McapSink
from palpate_devices.rosbag2_replay import Rosbag2Replay
from palpate_devices.sim import SimulatedRig


@plugin
def palpate_devices() -> dict[str, type[Device]]:
    """Robots, sensors, simulated rigs and logs."""
    logs: dict[str, type[Device]] = {
        "csv-replay": CsvReplay,
        "mcap-replay": McapReplay,
        "rosbag2-replay": Rosbag2Replay,
    }
    return {"sim": SimulatedRig, **logs}


@plugin
def palpate_sinks() -> dict[str, type[Sink]]:
    """Places to write to."""
    return {"mcap": McapSink, "csv": CsvSink}
