"""Logs: tables, bags and curves of other programs, and commands that look into any log."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate import Command, Template, plugin
from palpate_kit.lazy_names import lazy_names

if TYPE_CHECKING:
    from palpate_logs.afm_replay import AfmReplay as AfmReplay
    from palpate_logs.csv_replay import CsvReplay as CsvReplay
    from palpate_logs.csv_sink import CsvSink as CsvSink
    from palpate_logs.rosbag2_replay import Rosbag2Replay as Rosbag2Replay


@plugin
def palpate_devices() -> dict[str, str]:
    """Return the devices that read logs."""
    return {
        "afm-replay": "palpate_logs.afm_replay:AfmReplay",
        "csv-replay": "palpate_logs.csv_replay:CsvReplay",
        "rosbag2-replay": "palpate_logs.rosbag2_replay:Rosbag2Replay",
    }


@plugin
def palpate_sinks() -> dict[str, str]:
    """Return the sink that writes a table."""
    return {"csv": "palpate_logs.csv_sink:CsvSink"}


@plugin
def palpate_templates() -> dict[str, Template]:
    """Return the template of tip and model for a pipeline of a force curve."""
    return {"afm-analysis": Template("palpate_logs", "templates/afm_analysis.toml", "tip and model of a force curve")}


@plugin
def palpate_commands() -> dict[str, Command]:
    """Return the commands that look at, export and recover logs."""
    package = "palpate_logs.commands"
    return {
        "info": Command(f"{package}.info:info", "Show what a log contains, and suggest a pipeline for it.", "logs"),
        "log export": Command(f"{package}.export:export", "A log as CSV, NPZ, MAT or Parquet.", "logs"),
        "log recover": Command(f"{package}.recover:recover", "The undamaged part of a log as a new log.", "logs"),
    }


__getattr__, __all__ = lazy_names(__name__, *palpate_devices().values(), *palpate_sinks().values())
