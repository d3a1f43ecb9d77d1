"""The plugins of installed distributions, from their files: `importlib.metadata` takes half of a command's start."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, reduce
from importlib import import_module
from pathlib import Path
from typing import Any

from palpate.plugin_origin import normalized_name

SHIPPED_BY = "palpate"  # the distribution whose plugins are palpate's own
GROUP = "palpate"  # of entry points
# A folder NAME-VERSION.dist-info or .egg-info on the import path, as in PEP 376 and before it.
_FOLDER = re.compile(r"([^-]+)(?:-.*)?\.(?:dist-info|egg-info)")
_HEADERS = ("METADATA", "PKG-INFO")  # files with the name and the version, of the one and of the other


@dataclass(frozen=True)
class InstalledPlugin:
    """An entry point of the group `palpate`."""

    distribution: str
    version: str
    entry: str
    target: str  # "module", or "module:object"

    @property
    def name(self) -> str:
        """Return ``palpate-punch 1.0 (punch)``."""
        return f"{self.distribution} {self.version} ({self.entry})"

    @property
    def own(self) -> bool:
        """Return True for a plugin of palpate's own distribution."""
        return self.distribution == SHIPPED_BY

    def load(self) -> Any:
        """Return its module, imported; raises what the import raises."""
        module, _, attributes = self.target.partition(":")
        return reduce(getattr, filter(None, attributes.split(".")), import_module(module))


@cache
def installed_plugins(import_path: tuple[str, ...]) -> tuple[InstalledPlugin, ...]:
    """Return the plugins of all distributions on an import path; looked up once in a process, for a thousand pipelines.

    palpate's own come first and the others by name, in one order on every machine. Of two distributions of one name
    that comes first on the path is the installed one, as for an import.
    """
    plugins: list[InstalledPlugin] = []
    names = set[str]()
    for folder in import_path:
        for name, place in _distributions(folder or "."):
            if name not in names:
                names.add(name)
                plugins += _plugins_in(place)
    shipped = [plugin for plugin in plugins if plugin.own]
    return (*shipped, *sorted((plugin for plugin in plugins if not plugin.own), key=lambda plugin: plugin.name))


def _distributions(folder: str) -> Iterator[tuple[str, str]]:
    """Yield the normalized name of each distribution in a folder of the import path, and its own folder."""
    try:
        names = sorted(os.listdir(folder))
    except OSError:  # a folder that does not exist, or an archive
        return
    for name in names:
        if match := _FOLDER.fullmatch(name):
            yield normalized_name(match[1]), f"{folder}/{name}"


def _plugins_in(place: str) -> Iterator[InstalledPlugin]:
    """Yield the plugins that a distribution states in its folder."""
    try:
        with open(f"{place}/entry_points.txt", encoding="utf-8") as file:
            text = file.read()
    except OSError:  # most distributions have none
        return
    for entry, target in _entries(text):
        headers = _headers(Path(place))
        yield InstalledPlugin(headers["name"], headers["version"], entry, target)


def _entries(text: str) -> Iterator[tuple[str, str]]:
    """Yield name and target of each entry of the group in the text of an ``entry_points.txt``, without its extras."""
    section = ""
    for line in map(str.strip, text.splitlines()):
        if line.startswith("["):
            section = line.strip("[]").strip()
        elif section == GROUP and "=" in line and not line.startswith("#"):
            name, _, target = line.partition("=")
            yield name.strip(), target.partition("[")[0].strip()


@cache
def _headers(place: Path) -> dict[str, str]:
    """Return ``name`` and ``version`` of a distribution by the headers of its metadata, else by its folder's name."""
    name, _, version = place.stem.partition("-")
    headers = {"name": name, "version": version}
    for path in (place / file for file in _HEADERS):
        if path.is_file():
            for line in path.read_text(encoding="utf-8", errors="replace").partition("\n\n")[0].splitlines():
                key, colon, value = line.partition(":")
                if colon and key.lower() in headers:
                    headers[key.lower()] = value.strip()
            break
    return headers
