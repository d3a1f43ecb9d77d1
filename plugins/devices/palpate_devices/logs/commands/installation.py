"""What ``palpate info`` says without a log: what this installation runs on."""

from __future__ import annotations

import importlib.metadata
import os
import platform

import typer
from palpate.host import function_of, registry as registries

_LIBRARIES = ("casadi", "numpy", "scipy", "llvmlite", "filterpy")


def show_installation() -> None:
    """Say which libraries and plugins there are, and what plugins have to say of the installation."""
    typer.echo(f"palpate {importlib.metadata.version('palpate')}")
    typer.echo(
        f"python {platform.python_version()} on {platform.system()} {platform.machine()}, {os.cpu_count()} cores"
    )
    registry = registries.load()
    for fact in registry.facts.values():
        typer.echo(function_of(fact)())
    for name in _LIBRARIES:
        typer.echo(f"{name} {_version(name)}")
    for plugin in registry.plugins:
        typer.echo(f"plugin {plugin.name}")
    for name, failure in registry.failures.items():
        typer.echo(f"plugin {name} could not be loaded: {failure}")


def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return "not installed"
