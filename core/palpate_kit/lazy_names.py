"""Python names of a family that are imported when they are first used."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any


def lazy_names(package: str, *targets: str) -> tuple[Callable[[str], Any], list[str]]:
    """Return ``__getattr__`` and ``__all__`` of a package that offers the names of targets ``module:name``.

    A family gives the targets that its hooks return, so that a part is registered once. `__getattr__` raises
    AttributeError for an unknown name, with a similar one.
    """
    modules = {name: module for module, _, name in (target.partition(":") for target in targets)}

    def import_name(name: str) -> Any:
        """Import the module of a public name, and return the object of that name."""
        if name in modules:
            return getattr(import_module(modules[name]), name)
        from palpate import suggest

        hint = "" if name.startswith("_") else suggest(name, modules)
        raise AttributeError(f"{package} has no {name!r}{hint}")

    return import_name, sorted(modules)
