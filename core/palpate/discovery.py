"""Finding plugins: what is installed and which files are named, what each offers, and what is wrong with it."""

from __future__ import annotations

import importlib.metadata
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from inspect import isabstract, isfunction
from pathlib import Path
from types import ModuleType
from typing import Any

import pluggy

from palpate import core_flags, hooks
from palpate.errors import PluginError, suggest
from palpate.migration import Migration
from palpate.trust import PluginFile

_DISTRIBUTION = "palpate"
_PREFIX = "palpate_"
_SOURCE = "__palpate_source__"  # what a plugin file's module is of


@dataclass(frozen=True)
class Plugin:
    """Where parts come from: a distribution's entry point, or a file."""

    name: str  # "palpate-punch 1.0 (punch)" or the file's path
    place: str = ""  # file of its module
    own: bool = False  # of palpate's own distribution
    digest: str = ""  # SHA-256 of what was executed, of a file


_CORE = Plugin(_DISTRIBUTION)


@dataclass(frozen=True)
class Discovery:
    """Every plugin that could be loaded, and why others could not."""

    manager: pluggy.PluginManager
    failures: Mapping[str, str]

    @cached_property
    def plugins(self) -> dict[Any, Plugin]:
        """Every plugin but the core itself, by its module."""
        mine = f"{_DISTRIBUTION} {importlib.metadata.version(_DISTRIBUTION)} ("
        return {
            module: Plugin(name, getattr(module, "__file__", None) or "", name.startswith(mine), _digest(module))
            for name, module in self.manager.list_name_plugin()
            if module is not core_flags
        }

    @property
    def oddities(self) -> tuple[str, ...]:
        """What is in plugins that were loaded, and is not as it was meant."""
        return tuple(odd for module, plugin in self.plugins.items() for odd in _oddities(module, plugin))

    def offers(self, hook: str) -> Iterator[tuple[Plugin, Any]]:
        """What each plugin, and the core, answers to a hook."""
        for module, plugin in {core_flags: _CORE, **self.plugins}.items():
            others = [other for _, other in self.manager.list_name_plugin() if other is not module]
            for offer in self.manager.subset_hook_caller(hook, others)():
                yield plugin, offer

    def named(self, kind: str, hook: str, root: type) -> dict[str, tuple[Any, Plugin]]:
        """Everything of a kind by name, with the plugin it comes from; raises PluginError where two claim one name."""
        found: dict[str, tuple[Any, Plugin]] = {}
        for plugin, offer in self.offers(hook):
            for name, item in _checked(offer, kind, hook, root, plugin):
                if name in found:
                    first = found[name][1].name
                    raise PluginError(f"{kind} {name!r} is claimed by two plugins: {first} and {plugin.name}")
                found[name] = item, plugin
        return found

    @property
    def migrations(self) -> tuple[Migration, ...]:
        """What plugins have renamed; raises PluginError where one offers anything else."""
        migrations: list[Migration] = []
        for plugin, offer in self.offers("palpate_migrations"):
            if not all(isinstance(migration, Migration) for migration in offer):
                raise PluginError(
                    f"plugin {plugin.name}: palpate_migrations returns {offer!r}, not a list of Migration"
                )
            migrations += offer
        return tuple(migrations)


def discover(files: Iterable[Path | PluginFile] = ()) -> Discovery:
    """Load every installed plugin and the given files; raises PluginError where a file fails to import."""
    manager = pluggy.PluginManager(hooks.PROJECT)
    manager.add_hookspecs(hooks)
    manager.register(core_flags, "palpate")
    failures: dict[str, str] = {}
    for name, entry in _installed(tuple(sys.path)):
        try:
            manager.register(entry.load(), name)
        except Exception as error:  # whatever a third-party import raises
            failures[name] = f"{type(error).__name__}: {error}"
    for given in files:
        file = given if isinstance(given, PluginFile) else PluginFile.read(given)
        manager.register(_import_file(file), str(file.path))
    return Discovery(manager, failures)


def refuse_abstract(name: str, part: Any, plugin: Plugin) -> None:
    """Raise PluginError for a part that does not define all that its kind asks for."""
    if isabstract(part):
        missing = ", ".join(sorted(part.__abstractmethods__))
        raise PluginError(f"plugin {plugin.name}: {name!r} ({part.__name__}) does not define {missing}")


@cache
def _installed(_: tuple[str, ...]) -> tuple[tuple[str, importlib.metadata.EntryPoint], ...]:
    """Every installed plugin with its name; looked up once in a process, which may build a thousand pipelines.

    pluggy's own loader drops a second distribution's entry of a taken name without a word, so it is not asked.
    """
    return tuple(
        (f"{entry.dist.name} {entry.dist.version} ({entry.name})" if entry.dist else entry.name, entry)
        for entry in importlib.metadata.entry_points(group=hooks.PROJECT)
    )


def _import_file(file: PluginFile) -> ModuleType:
    """The module of a file: that of the last time where nobody has changed it, for its classes are to stay the same.

    Its content is compiled as it was read: another file there by now, or compiled code beside it, is not executed.
    """
    name = f"palpate_file_{file.path.stem}"
    before = sys.modules.get(name)
    if before is not None and _is_of(before, file):
        return before
    module = ModuleType(name)
    module.__file__ = str(file.path)
    sys.modules[name] = module
    try:
        exec(compile(file.content, str(file.path), "exec", dont_inherit=True), module.__dict__)
    except Exception as error:
        raise PluginError(f"plugin file {file.path} fails to import: {type(error).__name__}: {error}") from error
    module.__dict__[_SOURCE] = file
    return module


def _is_of(module: ModuleType, file: PluginFile) -> bool:
    source = module.__dict__.get(_SOURCE)
    return source is not None and (source.path.resolve(), source.content) == (file.path.resolve(), file.content)


def _digest(module: Any) -> str:
    source = getattr(module, _SOURCE, None)
    return source.digest if isinstance(source, PluginFile) else ""


def _oddities(module: Any, plugin: Plugin) -> Iterator[str]:
    """Functions that look like hooks and are none, and a plugin without any."""
    known = {name for name in vars(hooks) if name.startswith(_PREFIX)}
    marked = {name for name, item in vars(module).items() if hasattr(item, f"{hooks.PROJECT}_impl")}
    named = {name for name, item in vars(module).items() if isfunction(item) and name.startswith(_PREFIX)}
    for name in sorted(marked - known):
        yield f"plugin {plugin.name}: {name} is no hook{suggest(name, known)}"
    for name in sorted(named - marked):
        hint = "" if name in known else f", and is no hook{suggest(name, known)}"
        yield f"plugin {plugin.name}: {name} is not marked @palpate.plugin{hint}"
    if not marked & known and not marked | named:
        yield f"plugin {plugin.name} offers nothing: it has no function marked @palpate.plugin, such as palpate_models"


def _checked(offer: Any, kind: str, hook: str, root: type, plugin: Plugin) -> Iterator[tuple[str, Any]]:
    """The items of an offer; raises PluginError where it is no mapping, or one of them is not of the kind."""
    if not isinstance(offer, Mapping):
        raise PluginError(f"plugin {plugin.name}: {hook} returns {offer!r}, not a mapping of names")
    for name, item in offer.items():
        if isinstance(item, str) and ":" in item and kind in hooks.KINDS:
            yield name, item  # a part that is imported when it is asked for
            continue
        if not (isinstance(item, root) or (isinstance(item, type) and issubclass(item, root))):
            raise PluginError(f"plugin {plugin.name}: {hook} offers {name!r}, which is no {root.__name__}")
        if isinstance(item, type):
            refuse_abstract(name, item, plugin)
        yield name, item
