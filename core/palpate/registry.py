"""The registry: finds plugins, loads them, and knows every part by kind and name."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from functools import cache, cached_property
from inspect import isabstract, isfunction
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import pluggy

from palpate import core_flags, hooks
from palpate.errors import PluginError
from palpate.extensions import (
    CalibrationReader,
    Check,
    Command,
    Diagnosis,
    Display,
    Fact,
    Recorder,
    Report,
    ReportSection,
    Summary,
    Template,
    function_of,
    imported,
)
from palpate.flags import Flag, FlagMeaning
from palpate.migration import Migration

if TYPE_CHECKING:
    from palpate.parts import Part, Settings

_SHOWN = 12  # names in a message
_DISTRIBUTION = "palpate"
_PREFIX = "palpate_"


@dataclass(frozen=True)
class Plugin:
    """Where parts come from: a distribution's entry point, or a file."""

    name: str  # "palpate-punch 1.0 (punch)" or the file's path
    place: str = ""  # file of its module
    own: bool = False  # of palpate's own distribution


_CORE = {core_flags: Plugin(_DISTRIBUTION)}


@dataclass(frozen=True)
class Entry:
    """One part that can be named in a pipeline."""

    name: str
    offered: type[Part] | str  # or "module:Class", which is imported when it is asked for
    plugin: Plugin
    root: type[Part]

    @cached_property
    def part(self) -> type[Part]:
        """The part; raises PluginError where what the plugin names cannot be imported or is none."""
        found: Any = imported(self.offered) if isinstance(self.offered, str) else self.offered
        if not (isinstance(found, type) and issubclass(found, self.root)):
            raise PluginError(f"plugin {self.plugin.name}: {self.name!r} ({self.offered}) is no {self.root.__name__}")
        _refuse_abstract(self.name, found, self.plugin)
        return found

    def is_of(self, part: type[Part]) -> bool:
        """Whether this is the entry of a part; imports nothing of another name."""
        if isinstance(self.offered, str):
            return self.offered.rpartition(":")[2] == part.__qualname__ and self.part is part
        return self.offered is part


@dataclass(frozen=True)
class FlagEntry:
    """What a flag's code means, and who registered it."""

    meaning: FlagMeaning
    plugin: Plugin


@dataclass(frozen=True)
class Registry:
    """Every part, by kind and name, every flag, and the plugins that could not be loaded, with the reason."""

    parts: Mapping[str, Mapping[str, Entry]]
    plugins: tuple[Plugin, ...] = ()
    failures: Mapping[str, str] = field(default_factory=dict)
    oddities: tuple[str, ...] = ()  # of plugins that were loaded, and of which something is not as it was meant
    commands: Mapping[str, Command] = field(default_factory=dict)
    tables: Mapping[str, type[Settings]] = field(default_factory=dict)  # of a pipeline file, besides the core's own
    sections: Mapping[str, ReportSection] = field(default_factory=dict)
    reports: Mapping[str, Report] = field(default_factory=dict)  # by the name of their command
    displays: Mapping[str, Display] = field(default_factory=dict)
    templates: Mapping[str, Template] = field(default_factory=dict)
    flags: Mapping[str, FlagEntry] = field(default_factory=dict)
    diagnoses: Mapping[str, Diagnosis] = field(default_factory=dict)
    summaries: Mapping[str, Summary] = field(default_factory=dict)
    recorders: Mapping[str, Recorder] = field(default_factory=dict)
    checks: Mapping[str, Check] = field(default_factory=dict)
    calibrations: Mapping[str, CalibrationReader] = field(default_factory=dict)
    facts: Mapping[str, Fact] = field(default_factory=dict)
    migrations: tuple[Migration, ...] = ()

    @property
    def notices(self) -> tuple[str, ...]:
        """What is wrong with plugins and does not stop anything."""
        lost = (f"plugin {plugin} could not be loaded: {reason}" for plugin, reason in self.failures.items())
        return (*lost, *self.oddities)

    def judged(self, flags: Iterable[Flag]) -> tuple[Flag, ...]:
        """Flags with their severity; one that nobody has registered is doubtful."""
        entries = ((flag, self.flags.get(flag.code)) for flag in flags)
        return tuple(replace(flag, severity=entry.meaning.severity if entry else "doubtful") for flag, entry in entries)

    def demand_sound(self, parts: Mapping[str, Mapping[str, Part]]) -> None:
        """Raise PluginError where a check of a plugin refuses one of a pipeline's parts, by kind and name."""
        for check in self.checks.values():
            function_of(check)(parts, self)

    def find(self, kind: str, name: str) -> type[Part]:
        """The part of a kind and name; raises PluginError with what there is, and what may have been meant."""
        entries = self.parts[kind]
        if name in entries:
            return entries[name].part
        failed = "".join(f"; plugin {plugin} could not be loaded: {why}" for plugin, why in self.failures.items())
        raise PluginError(f"there is no {kind} {name!r}{suggest(name, entries)}{failed}")

    def command(self, name: str) -> Command:
        """A subcommand; raises PluginError with what there is, and what may have been meant."""
        if name not in self.commands:
            failed = "".join(f"; plugin {plugin} could not be loaded: {why}" for plugin, why in self.failures.items())
            hint = suggest(name, self.commands)
            # An editable installation knows the plugins of the day it was made.
            hint += "" if "did you mean" in hint else "; after an update, install palpate anew (pip install)"
            raise PluginError(f"there is no command {name!r}{hint}{failed}")
        return self.commands[name]

    def name_of(self, part: type[Part]) -> str:
        """The name by which a pipeline asks for a part."""
        return next(name for name, entry in self.parts[part.kind].items() if entry.is_of(part))


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
    manager, failures = _loaded(files)
    plugins = _plugins(manager)
    entries = {
        kind: {
            name: Entry(name, part, plugin, root)
            for name, (part, plugin) in _collect(manager, plugins, hook, root, kind, _refuse_abstract).items()
        }
        for kind, (hook, root) in hooks.KINDS.items()
    }
    offered = {
        kind: _offered(manager, plugins, hook, root, kind)
        for kind, (hook, root) in hooks.EXTENSIONS.items()
        if kind != "flag"  # the core registers flags, too
    }
    hook, root = hooks.EXTENSIONS["flag"]
    flags = {
        code: FlagEntry(meaning, plugin)
        for code, (meaning, plugin) in _collect(manager, {**_CORE, **plugins}, hook, root, "flag").items()
    }
    return Registry(
        entries,
        tuple(plugins.values()),
        failures,
        tuple(odd for module, plugin in plugins.items() for odd in _oddities(module, plugin)),
        commands=offered["command"],
        tables=offered["table"],
        sections=offered["report section"],
        reports=offered["report"],
        displays=offered["display"],
        templates=offered["template"],
        flags=flags,
        diagnoses=offered["diagnosis"],
        summaries=offered["summary"],
        recorders=offered["recorder"],
        checks=offered["check"],
        calibrations=offered["calibration"],
        facts=offered["fact"],
        migrations=_collect_migrations(manager, plugins),
    )


def load_commands(files: Iterable[Path] = ()) -> Registry:
    """Only the commands of every installed plugin and of the given files; raises like `load`."""
    manager, failures = _loaded(files)
    plugins = _plugins(manager)
    commands = _offered(manager, plugins, "palpate_commands", Command, "command")
    return Registry({}, tuple(plugins.values()), failures, commands=commands)


def offers(hook: str, root: type) -> dict[str, Any]:
    """What all that is installed offers by one hook, each of a class `root`, by name; parts are not imported."""
    manager, _ = _loaded(())
    return _offered(manager, {**_CORE, **_plugins(manager)}, hook, root)


def analysis(name: str) -> Callable[..., Any]:
    """The function behind a subcommand, whichever plugin offers it; raises PluginError where none does."""
    return function_of(load_commands().command(name))


def _plugins(manager: pluggy.PluginManager) -> dict[Any, Plugin]:
    """Every plugin but the core itself, by its module."""
    mine = f"{_DISTRIBUTION} {importlib.metadata.version(_DISTRIBUTION)} ("
    return {
        module: Plugin(name, getattr(module, "__file__", None) or "", name.startswith(mine))
        for name, module in manager.list_name_plugin()
        if module is not core_flags
    }


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


def _loaded(files: Iterable[Path]) -> tuple[pluggy.PluginManager, dict[str, str]]:
    """A manager with every plugin that could be loaded, and why others could not."""
    manager = pluggy.PluginManager(hooks.PROJECT)
    manager.add_hookspecs(hooks)
    manager.register(core_flags, "palpate")
    failures: dict[str, str] = {}
    for name, entry in _installed(tuple(sys.path)):
        try:
            manager.register(entry.load(), name)
        except Exception as error:  # whatever a stranger's import raises
            failures[name] = f"{type(error).__name__}: {error}"
    for path in files:
        manager.register(_import_file(path), str(path))
    return manager, failures


@cache
def _installed(_: tuple[str, ...]) -> tuple[tuple[str, importlib.metadata.EntryPoint], ...]:
    """Every installed plugin with its name; looked up once in a process, which may build a thousand pipelines.

    pluggy's own loader drops a second distribution's entry of a taken name without a word, so it is not asked.
    """
    return tuple(
        (f"{entry.dist.name} {entry.dist.version} ({entry.name})" if entry.dist else entry.name, entry)
        for entry in importlib.metadata.entry_points(group=hooks.PROJECT)
    )


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


def _offered(
    manager: pluggy.PluginManager, plugins: Mapping[Any, Plugin], hook: str, root: type, kind: str = "name"
) -> dict[str, Any]:
    return {name: offer for name, (offer, _) in _collect(manager, plugins, hook, root, kind).items()}


def _collect(
    manager: pluggy.PluginManager,
    plugins: Mapping[Any, Plugin],
    hook: str,
    root: type,
    kind: str,
    check: Callable[[str, Any, Plugin], None] | None = None,
) -> dict[str, tuple[Any, Plugin]]:
    """Everything of a kind by name, with the plugin it comes from; raises PluginError where two claim one name."""
    found: dict[str, tuple[Any, Plugin]] = {}
    for module, plugin in plugins.items():
        others = [other for _, other in manager.list_name_plugin() if other is not module]
        for offer in manager.subset_hook_caller(hook, others)():
            for name, item in _checked(offer, hook, root, plugin):
                if check is not None:
                    check(name, item, plugin)
                if name in found:
                    first = found[name][1].name
                    raise PluginError(f"{kind} {name!r} is claimed by two plugins: {first} and {plugin.name}")
                found[name] = item, plugin
    return found


def _collect_migrations(manager: pluggy.PluginManager, plugins: Mapping[Any, Plugin]) -> tuple[Migration, ...]:
    migrations: list[Migration] = []
    for module, plugin in plugins.items():
        others = [other for _, other in manager.list_name_plugin() if other is not module]
        for offer in manager.subset_hook_caller("palpate_migrations", others)():
            if not all(isinstance(migration, Migration) for migration in offer):
                raise PluginError(
                    f"plugin {plugin.name}: palpate_migrations returns {offer!r}, not a list of Migration"
                )
            migrations += offer
    return tuple(migrations)


def _checked(offer: Any, hook: str, root: type, plugin: Plugin) -> Iterable[tuple[str, Any]]:
    if not isinstance(offer, Mapping):
        raise PluginError(f"plugin {plugin.name}: {hook} returns {offer!r}, not a mapping of names")
    for name, item in offer.items():
        if isinstance(item, str) and root in (part for _, part in hooks.KINDS.values()) and ":" in item:
            continue  # a part that is imported when it is asked for
        if not (isinstance(item, root) or (isinstance(item, type) and issubclass(item, root))):
            raise PluginError(f"plugin {plugin.name}: {hook} offers {name!r}, which is no {root.__name__}")
    return list(offer.items())


def _refuse_abstract(name: str, part: Any, plugin: Plugin) -> None:
    if not isinstance(part, str) and isabstract(part):
        missing = ", ".join(sorted(part.__abstractmethods__))
        raise PluginError(f"plugin {plugin.name}: {name!r} ({part.__name__}) does not define {missing}")
