"""``palpate info`` without a log: what this installation runs on."""

from __future__ import annotations

import importlib.metadata
import os
import platform
from typing import Any

import typer
from palpate.host import function_of, print_json, registry as registries

_LIBRARIES = ("casadi", "numpy", "scipy", "llvmlite", "filterpy")


def show_installation(as_json: bool = False) -> None:
    """List libraries and plugins, and the plugins' facts on the installation."""
    registry = registries.load()
    found: dict[str, Any] = {
        "palpate": importlib.metadata.version("palpate"),
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.machine()}",
        "cores": os.cpu_count(),
        "facts": [function_of(fact)() for fact in registry.facts.values()],
        "libraries": {name: _version(name) for name in _LIBRARIES},
        "plugins": [plugin.name for plugin in registry.plugins],
        "failures": {name: str(failure) for name, failure in registry.failures.items()},
    }
    if as_json:
        print_json(found)
        return
    typer.echo(f"palpate {found['palpate']}")
    typer.echo(f"python {found['python']} on {found['system']}, {found['cores']} cores")
    lines = [*found["facts"], *(f"{name} {version}" for name, version in found["libraries"].items())]
    lines += [f"plugin {name}" for name in found["plugins"]]
    lines += [f"plugin {name} could not be loaded: {failure}" for name, failure in found["failures"].items()]
    for line in lines:
        typer.echo(line)


def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return "not installed"
