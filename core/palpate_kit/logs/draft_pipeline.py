"""From a log to a pipeline that reads it: the tables that its device suggests, and a template for the others."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from palpate import LogError, PluginError, printable
from palpate_engine import Registry, registry as registries
from palpate_records.recording import Recording, Suggestion, SupportsSurvey, SystemSurvey
from palpate_records.tables.binary_tables import is_binary_table, record_sheets

from palpate_kit.logs.suggestion import delay_hint

_ADDRESS = re.compile(r"^[a-z]\w*:/{1,2}")  # a path loses one of two slashes


# Endings of files that hold records which no device reads, with the remedy.
UNREAD = {
    ".xls": "save it as .xlsx",
    ".ods": "save it as .xlsx or .csv",
    ".tdms": "export it as .csv, or load it in Python (nptdms)",
    ".bag": "a bag of ROS 1: convert it with rosbags-convert --src FILE.bag --dst FOLDER",
    ".itx": "export it from Igor as .ibw or .csv",
    ".nid": "export it from Nanosurf's program as text with time, height and force",
    ".spm": "export it from NanoScope as text with time, height and force",
    ".pfc": "export its curves from NanoScope as text with time, height and force",
    ".hld": "export it from TriboScan as text with time, depth and load",
}

# The same for files that may hold anything: a folder of curves has no row for them.
ARCHIVES = {
    ".pkl": "a pickle may run code when it is read, so it never is; save the table as .csv, .npz or .parquet",
    ".zip": "unpack it, and give the folder",
}

# Of what is behind the sensor where nothing states it (0351); a draft lists it under `assumed`, until it is weighed.
_ASSUMED_MASS = "140 g"
_REPLAY = "-replay"  # end of the names of palpate's devices that read logs (0491)


def recording_of(log: Path, registry: Registry | None = None) -> type[Recording]:
    """Return the device that reads logs of this format; raises LogError if no device reads it."""
    if not log.exists():
        raise LogError(f"{log}: no such file")
    devices = registry or registries.load()
    if (reader := reader_of(log, devices)) is not None:
        return reader
    if log.is_dir():
        remedy = f"read its files one by one, or all of them: palpate fit {log} --tip 'sphere 3 mm'"
        raise LogError(f"{log}: is a folder, and no log; {remedy}")
    if (advice := {**UNREAD, **ARCHIVES}.get(log.suffix.lower())) is not None:
        raise LogError(f"{log}: {log.suffix.lower()} files are not read: {advice}")
    if is_binary_table(log):
        record_sheets(log)  # raises LogError with the reason
    raise LogError(
        f"{log}: is neither a text with rows of numbers in columns nor a log of a known format; export time, position "
        "and force as .csv"
    )


def system_at(address: str) -> SystemSurvey | None:
    """Return the running system at an address such as ``ros2://0``; None if the text is not an address."""
    if not _ADDRESS.match(address):
        return None
    parts: Iterator[Any] = (entry.part for entry in registries.load().parts["device"].values())
    systems = (part.system_at(address) for part in parts if isinstance(part, SupportsSurvey))
    return next((system for system in systems if system is not None), None)


def reader_of(log: Path, registry: Registry) -> type[Recording] | None:
    """Return the device that reads logs of this format; None without one.

    Of several the first, palpate's own before others; a reader of last resort only if no other recognises the log.
    """
    last_resort: type[Recording] | None = None
    for _, reader in _readers(registry):
        if not reader.recognises(log):
            continue
        if not reader.is_last_resort(log):
            return reader
        last_resort = last_resort or reader
    return last_resort


def _readers(registry: Registry) -> Iterator[tuple[str, type[Recording]]]:
    """Yield the devices that read logs, by name; one that cannot be imported reads none.

    Those of palpate are called replays, so that a fit of logs imports none of its robots.
    """
    for name, entry in registry.parts["device"].items():
        if entry.plugin.own and not name.endswith(_REPLAY):
            continue
        if entry.problem is None and issubclass(entry.part, Recording):
            yield name, entry.part


def suggestion_of(log: Path, choices: dict[str, str], registry: Registry | None = None) -> Suggestion:
    """Return the suggestion of a log's device, with roles as in `choices`; raises LogError if no device reads it."""
    return recording_of(log, registry).suggest(log, choices)


def rate_note(choices: Mapping[str, str], suggestions: Iterable[Suggestion]) -> str | None:
    """Return a note on the number of logs for which a chosen rate is ignored, since they have a time; else None."""
    count = sum(suggestion.has_time for suggestion in suggestions) if "rate" in choices else 0
    if not count:
        return None
    files = "file that has" if count == 1 else "files that have"
    return f"--rate is ignored for {count} {files} a time"


def pipeline_of(suggestion: Suggestion, log: Path, beside: Path | None = None) -> str:
    """Return a pipeline in TOML with its reasons; the log's path is relative to the folder `beside`, if there is one.

    `suggestion` has the tables by which the log is read; a template has the rest, tip, model and estimators. Raises
    PluginError if no plugin offers the suggested template.
    """
    templates = registries.load().templates
    if suggestion.template not in templates:
        raise PluginError(f"no plugin offers the template {suggestion.template!r} of tip, model and estimators")
    if beside is not None:
        device = {**suggestion.device, "file": os.path.relpath(log.resolve(), beside.resolve())}
        suggestion = replace(suggestion, device=device)
    tables = templates[suggestion.template].text()
    if (speed := suggestion.sweep_speed) is not None:
        speed_text = f"{1e3 * speed:.3g}" if math.isfinite(speed) else "?"
        tables += f'sweep_speed = "{speed_text} mm/s"\n'
    return pipeline_text(suggestion, log, tables)


def pipeline_text(suggestion: Suggestion, log: Path, rest: str) -> str:
    """Return a whole pipeline in TOML: the suggested tables with their reasons, then the `rest` of the tables."""
    lines = [
        *_comment_lines(suggestion, log),
        "",
        "[run]",
        f"name = {_toml(log.name)}",
        "# Not stated anywhere: correct these below, and take them out of this list.",
        f"assumed = {_toml(list(suggestion.assumed))}",
        "",
        *_device_lines(suggestion),
        "",
        '# Timing shifts the viscosity: declare what is known of it, as in delay = "0 ms", uncertainty = "1 ms".',
        "[alignment]",
        *(f"{key} = {_toml(value)}" for key, value in suggestion.alignment.items()),
    ]
    if "tip_mass" not in suggestion.alignment:
        mass_setting = f"tip_mass = {_toml(_ASSUMED_MASS)}"
        lines.append(f"{mass_setting:<39}# everything mounted behind the sensor: weigh it")
    return "\n".join(lines) + "\n\n" + rest


def _comment_lines(suggestion: Suggestion, log: Path) -> list[str]:
    """Return reasons, blanks, doubts and hints of a suggestion as comments."""
    texts = [f"A pipeline for {log.name}. What was found, and why:", *(f"  {text}" for text in suggestion.reasons)]
    texts += [f"FILL IN {text}" for text in suggestion.blanks]
    texts += [f"CHECK {text}" for text in suggestion.doubts]
    texts += [*suggestion.hints, *delay_hint(suggestion)]
    return [f"# {printable(text)}" for text in texts]


def _device_lines(suggestion: Suggestion) -> list[str]:
    """Return the tables of the device; keys that the user has to fill in are marked."""
    lines = ["[device.log]"]
    tables = {key: value for key, value in suggestion.device.items() if key in ("signals", "columns")}
    for key, value in suggestion.device.items():
        if key not in tables:
            is_blank = any(text.startswith(f"{key}:") for text in suggestion.blanks)
            lines.append(f"{key} = {_toml(value)}{'    # FILL IN' if is_blank else ''}")
    for key, table in tables.items():
        lines += ["", f"[device.log.{key}]", *(f"{name} = {_toml(item)}" for name, item in table.items())]
    return lines


def _toml(value: Any) -> str:
    """Return a value in TOML, on one line."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_toml(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    escaped = str(value).replace("\\", "\\\\").replace('"', '\\"')
    return f'"{printable(escaped)}"'
