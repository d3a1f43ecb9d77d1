"""Devices and sinks: the outside world."""

from palpate import Device, Sink, Twin, plugin

from palpate_devices.bota.device import BotaSensor
from palpate_devices.csv_replay import CsvReplay
from palpate_devices.csv_sink import CsvSink
from palpate_devices.mcap_replay import McapReplay
from palpate_devices.mcap_sink import McapSink
from palpate_devices.rosbag2_replay import Rosbag2Replay
from palpate_devices.sim import SimulatedRig
from palpate_devices.twins.bench import VirtualBench
from palpate_devices.ur3e.device import UR3e


@plugin
def palpate_devices() -> dict[str, type[Device]]:
    """Robots, sensors, simulated rigs and logs."""
    logs: dict[str, type[Device]] = {
        "csv-replay": CsvReplay,
        "mcap-replay": McapReplay,
        "rosbag2-replay": Rosbag2Replay,
    }
    return {"sim": SimulatedRig, "ur3e": UR3e, "bota": BotaSensor, **logs}


@plugin
def palpate_sinks() -> dict[str, type[Sink]]:
    """Places to write to."""
    return {"mcap": McapSink, "csv": CsvSink}


@plugin
def palpate_twins() -> dict[str, type[Twin]]:
    """Robots and sensors in software that speak the protocols of the real ones."""
    return {"ur3e-bota": VirtualBench}
