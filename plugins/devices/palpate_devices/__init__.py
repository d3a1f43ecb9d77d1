"""Devices and sinks: the outside world."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate import Command, Fact, FlagMeaning, lazily, plugin

if TYPE_CHECKING:
    from palpate_devices.afm_replay import AfmReplay
    from palpate_devices.bota.device import BotaSensor
    from palpate_devices.csv_replay import CsvReplay
    from palpate_devices.csv_sink import CsvSink
    from palpate_devices.mcap_replay import McapReplay
    from palpate_devices.mcap_sink import McapSink
    from palpate_devices.rdt.device import RdtSensor
    from palpate_devices.ros2.device import Ros2Device
    from palpate_devices.ros2.sink import Ros2Sink
    from palpate_devices.rosbag2_replay import Rosbag2Replay
    from palpate_devices.sim import SimulatedRig
    from palpate_devices.twins.bench import VirtualBench
    from palpate_devices.ur3e.device import UR

__getattr__ = lazily(
    __name__,
    {
        "palpate_devices.afm_replay": "AfmReplay",
        "palpate_devices.bota.device": "BotaSensor",
        "palpate_devices.csv_replay": "CsvReplay",
        "palpate_devices.csv_sink": "CsvSink",
        "palpate_devices.mcap_replay": "McapReplay",
        "palpate_devices.mcap_sink": "McapSink",
        "palpate_devices.rdt.device": "RdtSensor",
        "palpate_devices.ros2.device": "Ros2Device",
        "palpate_devices.ros2.sink": "Ros2Sink",
        "palpate_devices.rosbag2_replay": "Rosbag2Replay",
        "palpate_devices.sim": "SimulatedRig",
        "palpate_devices.twins.bench": "VirtualBench",
        "palpate_devices.ur3e.device": "UR",
    },
)

__all__ = [
    "UR",
    "AfmReplay",
    "BotaSensor",
    "CsvReplay",
    "CsvSink",
    "McapReplay",
    "McapSink",
    "RdtSensor",
    "Ros2Device",
    "Ros2Sink",
    "Rosbag2Replay",
    "SimulatedRig",
    "VirtualBench",
]


@plugin
def palpate_devices() -> dict[str, str]:
    """Robots, sensors, simulated rigs and logs."""
    return {
        "sim": "palpate_devices.sim:SimulatedRig",
        "ur": "palpate_devices.ur3e.device:UR",
        "ur3e": "palpate_devices.ur3e.device:UR",
        "bota": "palpate_devices.bota.device:BotaSensor",
        "rdt": "palpate_devices.rdt.device:RdtSensor",
        "ros2": "palpate_devices.ros2.device:Ros2Device",
        "afm-replay": "palpate_devices.afm_replay:AfmReplay",
        "csv-replay": "palpate_devices.csv_replay:CsvReplay",
        "mcap-replay": "palpate_devices.mcap_replay:McapReplay",
        "rosbag2-replay": "palpate_devices.rosbag2_replay:Rosbag2Replay",
    }


@plugin
def palpate_sinks() -> dict[str, str]:
    """Places to write to."""
    return {
        "mcap": "palpate_devices.mcap_sink:McapSink",
        "csv": "palpate_devices.csv_sink:CsvSink",
        "ros2": "palpate_devices.ros2.sink:Ros2Sink",
    }


@plugin
def palpate_twins() -> dict[str, str]:
    """Robots and sensors in software that use the protocols of the real ones."""
    return {"ur3e-bota": "palpate_devices.twins.bench:VirtualBench"}


@plugin
def palpate_commands() -> dict[str, Command]:
    """Looking at logs."""
    where = "palpate_devices.logs.commands"
    return {
        "info": Command(f"{where}.info:info", "Contents of a log, and a pipeline that reads it.", "logs"),
        "export": Command(f"{where}.export:export", "A log as CSV, NPZ, MAT or Parquet.", "logs"),
        "record": Command(f"{where}.record:record", "The streams of a pipeline into a log, without estimates.", "run"),
        "recover": Command(f"{where}.recover:recover", "Recover the undamaged part of a log into a new log.", "logs"),
    }


@plugin
def palpate_facts() -> dict[str, Fact]:
    """Whether a robot can be driven from here."""
    return {"robots": Fact("palpate_devices.ur3e.client:robots_here")}


@plugin
def palpate_flags() -> dict[str, FlagMeaning]:
    """Flags on topics of a ROS 2 system."""
    return {
        "ros2-limit": FlagMeaning(
            "doubtful",
            "A reading exceeded a limit of the device; nothing was stopped: palpate moves no robot over ROS.",
            "Look at the motion and at the controller's own limits.",
        ),
        "ros2-publishers": FlagMeaning(
            "doubtful",
            "Two publishers sent on one topic; only the first was read.",
            "Stop one of them, or give it another topic.",
        ),
        "ros2-restarted": FlagMeaning(
            "doubtful",
            "A publisher left and another one took over its topic: tare and settings may differ.",
            "Look at the driver, and record again.",
        ),
        "ros2-unread": FlagMeaning(
            "doubtful",
            "A topic cannot be read as published: it has another type, or is best effort where reliable is asked for.",
            "Check who publishes it (palpate info ros2://DOMAIN), and whether it is still the same driver.",
        ),
        "ros2-clock": FlagMeaning(
            "doubtful",
            "The stamps of a publisher jumped, as when a clock is set; they were mapped again from there on.",
            "Let the clocks of all computers settle before a record (chrony, PTP).",
        ),
        "ros2-clocks": FlagMeaning(
            "invalid",
            'Topics declared to share one clock (clocks = "one") are stamped by several that do not agree.',
            'Synchronise the computers (chrony, PTP), or set clocks = "each".',
        ),
        "ros2-missing": FlagMeaning(
            "note",
            "Messages are missing between the stamps of those received.",
            'Use a wire, a larger history, or reliability = "reliable".',
        ),
        "ros2-damaged": FlagMeaning(
            "note",
            "Messages could not be read, and were left out.",
            "Check who publishes them, and whether the type given is theirs.",
        ),
    }
