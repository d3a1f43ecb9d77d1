"""Place at which another process finds a class: a module, or a plugin file with the content that was executed here."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from palpate_engine import plugin_file_of


def class_place(part_class: type) -> dict[str, Any]:
    """Return the place of a class, as plain data."""
    file = plugin_file_of(sys.modules[part_class.__module__])
    source = {"file": str(file.path.resolve()), "sha256": file.digest} if file else {"file": None}
    return {"module": part_class.__module__, "name": part_class.__qualname__, **source}


def class_at(place: Mapping[str, Any]) -> Any:
    """Return the class at its place; raises UserError where its plugin file has changed since the parent executed
    it."""
    if place["file"] is None:
        module = importlib.import_module(place["module"])
    else:
        from palpate_engine import approved_files, import_plugin_file, inherited_approval

        with inherited_approval([place["sha256"]]):
            (file,) = approved_files([Path(place["file"])], Path(), named=False)
        module = import_plugin_file(file)
    return getattr(module, place["name"])
