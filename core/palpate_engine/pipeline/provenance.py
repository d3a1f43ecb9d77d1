"""Provenance: what it takes to redo a run."""

from __future__ import annotations

import hashlib
import importlib.metadata
import platform
import socket
import sys
import threading
from collections.abc import Mapping
from concurrent.futures import Future
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from palpate.device import is_live
from palpate.errors import PluginError
from palpate.parts import input_files
from palpate.sink import Extent
from palpate.trajectory import Lifted, duration_of, setpoints_at

from palpate_engine.config import Pipeline, third_party_versions

_LIBRARIES = ("casadi", "numpy", "scipy", "pydantic", "pluggy", "mcap")
_LOOK = 0.01  # [s] between the places that count for the box of a motion: a choice, 2 mm at 0.2 m/s


def run_facts(pipeline: Pipeline) -> dict[str, Any]:
    """Return name, pipeline, command, seed, versions, plugins, hashes of the inputs and host of a run.

    Raises PluginError for a device whose provenance is not a mapping.
    """
    inputs = dict[str, str]()
    for name, device in pipeline.devices.items():
        provenance: Any = device.provenance
        if not isinstance(provenance, Mapping):
            raise PluginError(f"device {name}: {type(device).__name__}.provenance is {provenance!r}, not a mapping")
        inputs |= {f"{name}.{key}": text for key, text in provenance.items()}
    for plugin in pipeline.registry.plugins:
        if plugin.digest:
            inputs[f"plugin.{Path(plugin.name).name}.sha256"] = plugin.digest
    for name, path in (("calibration", pipeline.run.calibration), ("control", pipeline.run.control)):
        if path is not None:
            with path.open("rb") as file:
                inputs[f"{name}.sha256"] = hashlib.file_digest(file, "sha256").hexdigest()
            inputs[f"{name}.file"] = str(path)
    for path in _input_files(pipeline):
        inputs[f"file.{path}.sha256"] = hashlib.sha256(path.read_bytes()).hexdigest()
    return {
        "name": pipeline.run.name,
        "pipeline": str(pipeline.path),
        "command": sys.argv,
        "seed": pipeline.run.seed,
        "versions": library_versions() | third_party_versions(pipeline),
        "plugins": [plugin.name for plugin in pipeline.registry.plugins],
        "inputs": inputs,
        "host": socket.gethostname(),
    }


def _input_files(pipeline: Pipeline) -> list[Path]:
    """Return the files, other than logs, that parts and tables take data from."""
    parts = (pipeline.devices, pipeline.indenters, pipeline.models, pipeline.surfaces, pipeline.trajectories)
    users = [part for named in (*parts, pipeline.tables) for part in named.values()]
    return list(dict.fromkeys(file for part in users for file in input_files(part)))


def facts_beside(pipeline: Pipeline) -> Future[dict[str, Any]]:
    """Return `run_facts`, by a thread: hashing a log takes as long as compiling. Nobody waits for it at exit."""
    future: Future[dict[str, Any]] = Future()

    def work() -> None:
        try:
            future.set_result(run_facts(pipeline))
        except BaseException as error:  # raised where the facts are asked for
            future.set_exception(error)

    threading.Thread(target=work, name="facts", daemon=True).start()
    return future


@cache
def library_versions() -> dict[str, str]:
    """Return the versions of palpate, of Python and of the libraries on which numbers depend."""
    versions = {"palpate": importlib.metadata.version("palpate"), "python": platform.python_version()}
    return versions | {name: importlib.metadata.version(name) for name in _LIBRARIES}


def lift_facts(pipeline: Pipeline) -> dict[str, Any]:
    """Return ``run.lifted`` of a motion above the specimen; nothing of others."""
    lifted = [motion for motion in pipeline.trajectories.values() if isinstance(motion, Lifted)]
    return {"lifted": {"height": lifted[0].lift, "pace": lifted[0].pace}} if lifted else {}


def flat_facts(facts: Mapping[str, Any]) -> dict[str, str]:
    """Return the facts that a log carries: versions, input hashes and seed, as texts by name."""
    lifted = {"lifted": f"{1e3 * facts['lifted']['height']:g} mm"} if "lifted" in facts else {}
    return {**facts["versions"], **facts["inputs"], "seed": str(facts["seed"]), **lifted}


def planned_duration(pipeline: Pipeline) -> float | None:
    """Return how long the record will be [s]: that of a log, or of standstill and motion; None where that is
    unknown."""
    logs = [device.duration for device in pipeline.devices.values() if device.duration is not None]
    if logs or len(pipeline.trajectories) != 1:
        return max(logs, default=None)
    (trajectory,) = pipeline.trajectories.values()
    live = is_live(pipeline.devices)
    return duration_of(trajectory) + (pipeline.safety.standstill if live and pipeline.safety else 0.0)


def planned_extent(pipeline: Pipeline) -> Extent | None:
    """Return the box [m] of the planned motion; None where nothing moves, or more than one motion is planned."""
    if len(pipeline.trajectories) != 1:
        return None
    (trajectory,) = pipeline.trajectories.values()
    places = setpoints_at(trajectory, np.arange(0.0, duration_of(trajectory) + _LOOK, _LOOK)).position
    return tuple(places.min(axis=0).tolist()), tuple(places.max(axis=0).tolist())
