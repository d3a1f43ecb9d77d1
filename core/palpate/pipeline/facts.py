"""Provenance: what it takes to redo a run."""

from __future__ import annotations

import hashlib
import importlib.metadata
import platform
import socket
import sys
from typing import Any

from palpate.config import Pipeline

_LIBRARIES = ("casadi", "numpy", "scipy", "pydantic", "pint", "pluggy", "mcap")


def run_facts(pipeline: Pipeline) -> dict[str, Any]:
    """Name, pipeline, command, seed, versions, plugins, hashes of the inputs, host."""
    versions = {"palpate": importlib.metadata.version("palpate"), "python": platform.python_version()}
    versions |= {name: importlib.metadata.version(name) for name in _LIBRARIES}
    inputs = {f"{name}.{key}": text for name, d in pipeline.devices.items() for key, text in d.provenance.items()}
    if pipeline.run.calibration is not None:
        with pipeline.run.calibration.open("rb") as file:
            inputs["calibration.sha256"] = hashlib.file_digest(file, "sha256").hexdigest()
        inputs["calibration.file"] = str(pipeline.run.calibration)
    return {
        "name": pipeline.run.name,
        "pipeline": str(pipeline.path),
        "command": sys.argv,
        "seed": pipeline.run.seed,
        "versions": versions,
        "plugins": [plugin.name for plugin in pipeline.registry.plugins],
        "inputs": inputs,
        "host": socket.gethostname(),
    }


def flat_facts(facts: dict[str, Any]) -> dict[str, str]:
    """The facts that a log carries: versions, input hashes and seed, as texts by name."""
    return {**facts["versions"], **facts["inputs"], "seed": str(facts["seed"])}
