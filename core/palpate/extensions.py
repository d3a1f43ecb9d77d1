"""What a plugin adds besides parts: commands, report sections, templates; plain data, nothing is imported for it."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from palpate.errors import PluginError

PANELS = {
    "run": "Run",
    "logs": "Look at logs",
    "analyse": "Analyse",
    "hardware": "Hardware",
    "extend": "Extend and look up",
}


@dataclass(frozen=True)
class Command:
    """A subcommand of ``palpate``: a function with typer annotations, imported when it is called."""

    target: str  # "module:function"
    help: str  # one line for `palpate --help`
    panel: str = "analyse"  # key of PANELS

    def function(self) -> Callable[..., Any]:
        """The function; raises PluginError where it cannot be imported."""
        return imported(self.target)


@dataclass(frozen=True)
class ReportSection:
    """A part of what is shown of a result: ``function(result)`` answers tables and texts, none where it has none."""

    target: str  # "module:function"
    order: int = 50  # sections are shown by increasing order

    def function(self) -> Callable[..., Any]:
        """The function; raises PluginError where it cannot be imported."""
        return imported(self.target)


@dataclass(frozen=True)
class Report:
    """What is made of a run that has ended: ``function(folder)`` writes a file and answers where it is."""

    target: str  # "module:function"

    def function(self) -> Callable[..., Any]:
        """The function; raises PluginError where it cannot be imported."""
        return imported(self.target)


@dataclass(frozen=True)
class Diagnosis:
    """A judge of results: ``function(evidence of all tracks)`` answers findings by track; see `palpate.diagnosis`."""

    target: str | Callable[..., Any]  # "module:function", imported when a run has ended; or the function

    def function(self) -> Callable[..., Any]:
        """The function; raises PluginError where it cannot be imported."""
        return imported(self.target) if isinstance(self.target, str) else self.target


@dataclass(frozen=True)
class Template:
    """A text that `palpate` writes for a user to fill in, from a plugin's package data."""

    package: str  # "palpate_filters"
    path: str  # within the package: "templates/point.toml"
    help: str  # one line

    def text(self) -> str:
        """The text; raises PluginError where the package lacks it."""
        from importlib.resources import files

        try:
            return files(self.package).joinpath(self.path).read_text(encoding="utf-8")
        except (OSError, ImportError) as error:
            raise PluginError(f"template {self.path} of {self.package} cannot be read: {error}") from error


def imported(target: str) -> Callable[..., Any]:
    """What ``module:name`` names; raises PluginError where it cannot be imported."""
    module, colon, name = target.partition(":")
    if not (module and colon and name):
        raise PluginError(f"{target!r} is no MODULE:FUNCTION")
    try:
        found: Callable[..., Any] = getattr(import_module(module), name)
    except (ImportError, AttributeError) as error:
        raise PluginError(f"{target} cannot be imported: {error}") from error
    return found


def lazily(module: str, places: Mapping[str, str]) -> Callable[[str], Any]:
    """The ``__getattr__`` of a module whose public names are imported when they are first used (PEP 562).

    `places` holds, for each module that defines some of the names, those names with blanks between them. The importing
    module repeats them under ``TYPE_CHECKING``, so that type checkers and editors see them, too.
    """
    where = {name: place for place, names in places.items() for name in names.split()}

    def find(name: str) -> Any:
        if name not in where:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        found = getattr(import_module(where[name]), name)
        setattr(sys.modules[module], name, found)
        return found

    return find
