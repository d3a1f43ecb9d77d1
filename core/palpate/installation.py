"""What ``palpate info`` says without a log: what this installation runs on."""

from __future__ import annotations

import importlib.metadata
import os
import platform

import typer

from palpate import registry as registries
from palpate.kernel import Step, compile_step, kernel_choice

_LIBRARIES = ("casadi", "numpy", "scipy", "llvmlite", "filterpy")


def show_installation() -> None:
    """Say which kernel runs the filters and why, and which libraries and plugins there are."""
    _, reason = kernel_choice()
    typer.echo(f"palpate {importlib.metadata.version('palpate')}")
    typer.echo(
        f"python {platform.python_version()} on {platform.system()} {platform.machine()}, {os.cpu_count()} cores"
    )
    typer.echo(f"kernel: {_kernel()} ({reason})")
    for name in _LIBRARIES:
        typer.echo(f"{name} {_version(name)}")
    registry = registries.load()
    for plugin in registry.plugins:
        typer.echo(f"plugin {plugin.name}")
    for name, failure in registry.failures.items():
        typer.echo(f"plugin {name} could not be loaded: {failure}")


def _kernel() -> str:
    """The kernel that a step really gets, not the one that it should."""
    import casadi

    x, w, p = (casadi.SX.sym(name) for name in "xwp")
    return compile_step(Step(x, w, p, x + p * w, x * w)).name


def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return "not installed"
