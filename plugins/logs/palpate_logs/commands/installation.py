"""``palpate info`` without a log: the libraries and plugins of this installation."""

from __future__ import annotations

import importlib.metadata
import os
import platform
from typing import Any

import typer
from palpate import ConfigurationError, Fact
from palpate_engine import function_of, registry as registries
from palpate_kit.terminal.json_output import print_json

_LIBRARIES = ("casadi", "numpy", "scipy", "llvmlite", "filterpy")


def show_installation(as_json: bool = False) -> None:
    """Print versions, libraries and plugins, and the facts on the installation that plugins state."""
    registry = registries.load()
    installation: dict[str, Any] = {
        "palpate": importlib.metadata.version("palpate"),
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.machine()}",
        "cores": os.cpu_count(),
        "facts": [_fact_line(name, fact) for name, fact in registry.facts.items()],
        "libraries": {name: _version(name) for name in _LIBRARIES},
        "plugins": [plugin.name for plugin in registry.plugins],
        "failures": dict(registry.failures),
    }
    if as_json:
        print_json(installation)
        return
    typer.echo(f"palpate {installation['palpate']}")
    typer.echo(f"python {installation['python']} on {installation['system']}, {installation['cores']} cores")
    lines = [*installation["facts"]]
    lines += [f"{name} {version}" for name, version in installation["libraries"].items()]
    lines += [f"plugin {name}" for name in installation["plugins"]]
    lines += registry.failures.values()
    for line in lines:
        typer.echo(line)


def _fact_line(name: str, fact: Fact) -> str:
    """Return the text of a fact; if the plugin's function fails, the error."""
    try:
        return str(function_of(fact)())
    except ConfigurationError:  # the user's environment
        raise
    except Exception as error:  # whatever a third-party function raises
        return f"the fact {name!r} is not known: {type(error).__name__}: {error}"


def _version(name: str) -> str:
    """Return the version of an installed library."""
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return "not installed"
