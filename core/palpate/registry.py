"""The registry: every part by kind and name, and all else that plugins offer."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate import hooks
from palpate.discovery import Discovery, discover
from palpate.entries import Entry, FlagEntry, full_name, resolve_older_name, unique_initials, version_number
from palpate.errors import ConfigurationError, PalpateError, PluginError, suggest
from palpate.first_versions import FIRST_VERSIONS, KINDS_WITH_OLDER_NAMES
from palpate.flags import Flag, FlagMeaning, judged_flags
from palpate.installed_plugins import installed_plugins
from palpate.offers import (
    CalibrationReader,
    Check,
    Command,
    ControlReader,
    Diagnosis,
    Display,
    Fact,
    FileSuggestion,
    Recorder,
    Report,
    ReportSection,
    Summary,
    Template,
    function_of,
)
from palpate.plugin_origin import Plugin, normalized_name
from palpate.plugin_switch import PluginSwitch
from palpate.trust import PluginFile, plugin_files_at_hand

if TYPE_CHECKING:
    from palpate.parts import Part, Settings

_OF_INSTALLED: dict[tuple[Any, ...], Registry] = {}  # the latest registry without plugin files, by `_installed_modules`


@dataclass(frozen=True)
class Registry:
    """Every part, by kind and name, every flag, and what failed in plugins."""

    parts: Mapping[str, Mapping[str, Entry]]
    plugins: tuple[Plugin, ...] = ()
    failures: Mapping[str, str] = field(default_factory=dict)  # by installed plugin: a sentence that names it
    oddities: tuple[str, ...] = ()  # of plugins that were loaded, and of which something is not as it was meant
    commands: Mapping[str, Command] = field(default_factory=dict)
    tables: Mapping[str, type[Settings]] = field(default_factory=dict)  # of a pipeline file, besides the core's own
    report_sections: Mapping[str, ReportSection] = field(default_factory=dict)
    reports: Mapping[str, Report] = field(default_factory=dict)  # by the name of their command
    displays: Mapping[str, Display] = field(default_factory=dict)
    templates: Mapping[str, Template] = field(default_factory=dict)
    flags: Mapping[str, FlagEntry] = field(default_factory=dict)
    diagnoses: Mapping[str, Diagnosis] = field(default_factory=dict)
    summaries: Mapping[str, Summary] = field(default_factory=dict)
    recorders: Mapping[str, Recorder] = field(default_factory=dict)
    checks: Mapping[str, Check] = field(default_factory=dict)
    calibrations: Mapping[str, CalibrationReader] = field(default_factory=dict)
    controls: Mapping[str, ControlReader] = field(default_factory=dict)
    facts: Mapping[str, Fact] = field(default_factory=dict)
    file_suggestions: Mapping[str, FileSuggestion] = field(default_factory=dict)
    ambiguous: Mapping[tuple[str, str], str] = field(default_factory=dict)  # by kind and name: names that nobody owns
    left_out: tuple[str, ...] = ()  # sentences on distributions that PALPATE_PLUGINS does not name
    older_names: tuple[str, ...] = ()  # sentences on names that mean another part than in a new pipeline

    @property
    def notices(self) -> tuple[str, ...]:
        """The faults of plugins that do not stop anything."""
        return (*self.failures.values(), *self.oddities, *self.left_out, *self.older_names)

    def judged(self, flags: Iterable[Flag]) -> tuple[Flag, ...]:
        """Return flags with severity and remedy, one for each cause; an unregistered one is doubtful."""
        return judged_flags(flags, self.meanings)

    @cached_property
    def meanings(self) -> Mapping[str, FlagMeaning]:
        """The meaning of each flag's code."""
        return {code: entry.meaning for code, entry in self.flags.items()}

    def demand_sound(self, parts: Mapping[str, Mapping[str, Part]]) -> None:
        """Raise PluginError where a check refuses one of a pipeline's parts, by kind and name, or fails itself."""
        for name, check in self.checks.items():
            try:
                function_of(check)(parts, self)
            except PalpateError:
                raise
            except Exception as error:  # whatever third-party code raises
                raise PluginError(f"check {name!r} raises {type(error).__name__}: {error}") from error

    def find(self, kind: str, name: str) -> type[Part]:
        """Return the part of a kind and name, or its initials; raises PluginError with the names and similar ones."""
        if full := full_name(self.parts[kind], name):
            return self.parts[kind][full].part
        raise PluginError(self._absence(kind, name, self.parts[kind]))

    def named(self, kind: str, name: str) -> str:
        """Return the full name of a part, from it or from its initials ("dr"); raises ConfigurationError."""
        if full := full_name(self.parts[kind], name):
            return full
        raise ConfigurationError(self._absence(kind, name, [*self.parts[kind], *unique_initials(self.parts[kind])]))

    def _absence(self, kind: str, name: str, names: Iterable[str]) -> str:
        """Return why no part has a name: several claim it, its distribution is not there, or it is unknown."""
        if sentence := self.ambiguous.get((kind, name)):
            return sentence
        distribution, colon, _ = name.partition(":")
        installed = {plugin.distribution for plugin in self.plugins}
        if colon and normalized_name(distribution) not in installed:
            return f"no {kind} {name!r}: the distribution {distribution} is not installed, or left out{self._lost}"
        return f"no {kind} {name!r}{suggest(name, names)}{self._lost}"

    def of_version(self, version: str) -> Registry:
        """Return the registry for a pipeline of a version, which may mean another part by a name that is newer."""
        parts = {kind: dict(entries) for kind, entries in self.parts.items()}
        ambiguous, sentences = dict(self.ambiguous), list(self.older_names)
        for (kind, name), first in FIRST_VERSIONS.items():
            if version_number(version) < version_number(first):
                new = f"{kind} {name!r} is new in palpate {first}, and the pipeline is of {version}"
                meant, refused = resolve_older_name(parts[kind], name, kind in KINDS_WITH_OLDER_NAMES)
                sentences += [f"{new}: {meant}"] if meant else []
                ambiguous |= {(kind, name): f"{new}: {refused}"} if refused else {}
        return replace(self, parts=parts, ambiguous=ambiguous, older_names=tuple(sentences))

    def command(self, name: str) -> Command:
        """Return a command by its whole name; raises PluginError with the names and similar ones."""
        if name not in self.commands:
            if sentence := self.ambiguous.get(("command", name)):
                raise PluginError(sentence)
            if below := self.subcommands(name):
                raise PluginError(f"{name!r} is the first word of commands (there are: {', '.join(sorted(below))})")
            # First words, and whole names by their last words: a person may mean either.
            first = {whole.partition(" ")[0] for whole in self.commands}
            by_part = {whole.rpartition(" ")[2]: whole for whole in self.commands} | {part: part for part in first}
            close = [by_part[part] for part in get_close_matches(name, by_part, n=1)]
            hint = suggest(close[0] if close else name, {*first, *close})
            # An editable installation knows the plugins of the day it was made.
            hint += "" if "did you mean" in hint else "; after an update, reinstall palpate (pip install)"
            raise PluginError(f"no command {name!r}{hint}{self._lost}")
        return self.commands[name]

    def subcommands(self, name: str) -> dict[str, Command]:
        """Return the subcommands of a command, or of the first word of several, by their own word."""
        head = f"{name} "
        return {full.removeprefix(head): command for full, command in self.commands.items() if full.startswith(head)}

    @property
    def _lost(self) -> str:
        """The notices on plugins that may have had a missing name, and on misspelt hooks."""
        return "".join(f"; {notice}" for notice in self.notices)

    def name_of(self, part: type[Part]) -> str:
        """Return the name of a part in pipelines on every machine."""
        return next(entry.qualified for entry in self.parts[part.kind].values() if entry.is_of(part))


def load(files: Iterable[Path | PluginFile] = ()) -> Registry:
    """Load every installed plugin, those of ``palpate --plugin FILE``, and the given files, which are executed.

    A distribution whose plugin fails to import, or has a hook that raises or offers something else than its kind, is
    noted in `failures` and does not stop the others; so is a name that two plugins claim, in `oddities`. Raises
    PluginError where a file fails, or claims a name of palpate's own.
    """
    if together := _with_files_at_hand(files):
        return _registry_of(discover(together))
    if registry := _OF_INSTALLED.get(_installed_modules()):
        return registry
    registry = _registry_of(discover())
    _OF_INSTALLED.clear()
    if not registry.failures:  # which may be mended the next time
        _OF_INSTALLED[_installed_modules()] = registry
    return registry


def _installed_modules() -> tuple[Any, ...]:
    """Return what the registry of the installed plugins depends on: where they are, who is admitted, their modules."""
    import_path = tuple(sys.path)
    modules = (sys.modules.get(plugin.target.partition(":")[0]) for plugin in installed_plugins(import_path))
    return import_path, PluginSwitch.of_environment(), *modules


def _registry_of(discovery: Discovery) -> Registry:
    """Return all that the plugins of a discovery offer."""
    # Parts by kind and key, of which the name is what follows the distribution.
    parts = dict[str, dict[str, Entry]]()
    for kind, (hook, root) in hooks.KINDS.items():
        entries = parts[kind] = dict[str, Entry]()
        for key, (part, plugin) in discovery.named(kind, hook, root).items():
            entries[key] = Entry(key.rpartition(":")[2], part, plugin, root)
    # Offers by the field of the registry; a flag keeps its plugin.
    offered: dict[str, Any] = {}
    for kind, (hook, root) in hooks.EXTENSIONS.items():
        items = offered[hook.removeprefix("palpate_")] = dict[str, Any]()
        for name, (offer, plugin) in discovery.named(kind, hook, root).items():
            items[name] = FlagEntry(offer, plugin) if kind == "flag" else offer
    plugins = tuple(discovery.plugins.values())
    offered |= discovery.offers
    offered |= {"ambiguous": discovery.ambiguous, "left_out": discovery.left_out}
    return Registry(parts, plugins, discovery.failures, discovery.oddities, **offered)


def _with_files_at_hand(files: Iterable[Path | PluginFile]) -> list[Path | PluginFile]:
    """Return the files of ``palpate --plugin FILE``, then those of the others that are not among them."""
    at_hand = plugin_files_at_hand()
    named_paths = {file.path.resolve() for file in at_hand}
    together: list[Path | PluginFile] = [*at_hand]
    for file in files:
        path = file.path if isinstance(file, PluginFile) else file
        if path.resolve() not in named_paths:
            together.append(file)
    return together


def load_commands() -> Registry:
    """Return only the commands of every installed plugin and of ``palpate --plugin FILE``; raises like `load`."""
    discovery = discover(plugin_files_at_hand())
    offered = discovery.named("command", "palpate_commands", Command)
    return Registry(
        {},
        tuple(discovery.plugins.values()),
        discovery.failures,
        discovery.oddities,
        commands={name: command for name, (command, _) in offered.items()},
        ambiguous=discovery.ambiguous,
        left_out=discovery.left_out,
    )


def offers(hook: str, root: type) -> dict[str, Any]:
    """Return the offers of all plugins by one hook, each of a class `root`, by name; parts are not imported."""
    return {name: offer for name, (offer, _) in discover(plugin_files_at_hand()).named("name", hook, root).items()}


def analysis(name: str) -> Callable[..., Any]:
    """Return the function behind a subcommand of any plugin; raises PluginError where none offers it."""
    return function_of(load_commands().command(name))
