"""The promised interface: its number, and the names that go."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

API = 1  # rises with each change that a plugin has to follow
OLDEST_API = 1  # that is understood: a number is kept for two MINOR versions after the next one
STATED_BY = "PALPATE_API"  # of a plugin's module
ASSUMED_API = 1  # of a plugin that states none

# Modules and names that go, by their full name: what replaces them, and the version in which they are gone.
DEPRECATED = {"palpate.host": ("palpate_engine", "0.3.0")}


@dataclass(frozen=True)
class DeprecatedUse:
    """A name that goes, and a plugin's file and line that use it."""

    name: str
    replacement: str
    gone_in: str  # version
    place: str  # "tips.py, line 3"


def interface_problem(module: ModuleType) -> str:
    """Return why the interface that a plugin's module states is not understood; empty where it is."""
    stated = stated_api(module)
    if stated is None or (isinstance(stated, int) and OLDEST_API <= stated <= API):
        return ""
    known = f"{API}" if OLDEST_API == API else f"{OLDEST_API} to {API}"
    return f"{STATED_BY} is {stated!r}, and this palpate knows {known}: install a palpate or a plugin that fits"


def stated_api(module: object) -> Any:
    """Return the number that a plugin's module states; None without one."""
    return getattr(module, STATED_BY, None)


def deprecated_uses(place: str) -> Iterator[DeprecatedUse]:
    """Yield the names that go which the files of a plugin import, by the file of its module."""
    path = Path(place)
    files = sorted(path.parent.rglob("*.py")) if path.name == "__init__.py" else [path]
    for file in files:
        try:
            tree = ast.parse(file.read_text(encoding="utf-8"))
        except (OSError, SyntaxError, ValueError):  # whoever imports it reports that
            continue
        for name, line in _imported_names(tree):
            for deprecated, (replacement, gone_in) in DEPRECATED.items():
                if name == deprecated or name.startswith(f"{deprecated}."):
                    yield DeprecatedUse(deprecated, replacement, gone_in, f"{file.name}, line {line}")


def _imported_names(tree: ast.AST) -> Iterator[tuple[str, int]]:
    """Yield the full name of each import with its line."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield from ((f"{node.module}.{alias.name}", node.lineno) for alias in node.names)
