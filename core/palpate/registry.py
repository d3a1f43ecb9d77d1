"""The registry: finds plugins, loads them, and knows every part by kind and name."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from inspect import isabstract
from pathlib import Path
from types import ModuleType
from typing import Any

import pluggy

from palpate import hooks
from palpate.errors import PluginError
from palpate.parts import Part

_SHOWN = 12  # names in a message


@dataclass(frozen=True)
class Plugin:
    """Where parts come from: a distribution's entry point, or a file."""

    name: str  # "palpate-punch 1.0 (punch)" or the file's path


@dataclass(frozen=True)
class Entry:
    """One part that can be named in a pipeline."""

    part: type[Part]
    plugin: Plugin


@dataclass(frozen=True)
class Registry:
    """Every part, by kind and name, and the plugins that could not be loaded, with the reason."""

    parts: Mapping[str, Mapping[str, Entry]]
    plugins: tuple[Plugin, ...] = ()
    failures: Mapping[str, str] = field(default_factory=dict)

    def find(self, kind: str, name: str) -> type[Part]:
        """The part of a kind and name; raises PluginError with what there is, and what may have been meant."""
        entries = self.parts[kind]
        if name in entries:
            return entries[name].part
        failed = "".join(f"; plugin {plugin} could not be loaded: {why}" for plugin, why in self.failures.items())
        raise PluginError(f"there is no {kind} {name!r}{suggest(name, entries)}{failed}")

    def name_of(self, part: type[Part]) -> str:
        """The name by which a pipeline asks for a part."""
        return next(name for name, entry in self.parts[part.kind].items() if entry.part is part)


def suggest(given: str, allowed: Iterable[str]) -> str:
    """``; did you mean 'x'? (there are: x, y)`` for messages about an unknown name."""
    names = sorted(allowed)
    close = get_close_matches(given, names, n=_SHOWN, cutoff=0.6)
    meant = f"; did you mean {close[0]!r}?" if close else ""
    shown = names if len(names) <= _SHOWN else [*(close or names[:_SHOWN]), "..."]
    return f"{meant} (there {'is' if len(names) == 1 else 'are'}: {', '.join(shown) or 'none'})"


def load(files: Iterable[Path] = ()) -> Registry:
    """Load every installed plugin and the given files.

    A distribution whose plugin fails to import is noted in `failures` and does not stop the others. Raises PluginError
    where two plugins claim one name, where a plugin offers something that is no part, or where a file fails to import.
    """
    manager = pluggy.PluginManager(hooks.PROJECT)
    manager.add_hookspecs(hooks)
    failures: dict[str, str] = {}
    for entry in importlib.metadata.entry_points(group=hooks.PROJECT):
        # pluggy's own loader drops a second distribution's entry of a taken name without a word: load them here.
        name = f"{entry.dist.name} {entry.dist.version} ({entry.name})" if entry.dist else entry.name
        try:
            manager.register(entry.load(), name)
        except Exception as error:  # whatever a stranger's import raises
            failures[name] = f"{type(error).__name__}: {error}"
    for path in files:
        manager.register(_import_file(path), str(path))
    return Registry(_collect(manager), tuple(Plugin(name) for name, _ in manager.list_name_plugin()), failures)


def _import_file(path: Path) -> ModuleType:
    if not path.is_file():
        raise PluginError(f"plugin file {path} does not exist")
    name = f"palpate_file_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise PluginError(f"plugin file {path} is not a Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise PluginError(f"plugin file {path} fails to import: {type(error).__name__}: {error}") from error
    return module


def _collect(manager: pluggy.PluginManager) -> dict[str, dict[str, Entry]]:
    parts: dict[str, dict[str, Entry]] = {kind: {} for kind in hooks.KINDS}
    plugins = {module: Plugin(name) for name, module in manager.list_name_plugin()}
    for kind, (hook, root) in hooks.KINDS.items():
        for module, plugin in plugins.items():
            others = [other for other in plugins if other is not module]
            for offer in manager.subset_hook_caller(hook, others)():
                for name, part in _checked(offer, hook, root, plugin):
                    if name in parts[kind]:
                        first = parts[kind][name].plugin.name
                        raise PluginError(f"{kind} {name!r} is claimed by two plugins: {first} and {plugin.name}")
                    parts[kind][name] = Entry(part, plugin)
    return parts


def _checked(offer: Any, hook: str, root: type[Part], plugin: Plugin) -> Iterable[tuple[str, type[Part]]]:
    if not isinstance(offer, Mapping):
        raise PluginError(f"plugin {plugin.name}: {hook} returns {offer!r}, not a mapping of names to classes")
    for name, part in offer.items():
        if not (isinstance(part, type) and issubclass(part, root)):
            raise PluginError(f"plugin {plugin.name}: {hook} offers {name!r}, which is no {root.__name__}")
        if isabstract(part):
            missing = ", ".join(sorted(part.__abstractmethods__))
            raise PluginError(f"plugin {plugin.name}: {name!r} ({part.__name__}) does not define {missing}")
    return list(offer.items())
