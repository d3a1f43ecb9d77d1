"""Entries of the registry: parts and flags with the plugins that offer them, and the names that reach a part."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from palpate.discovery import missing_methods
from palpate.errors import PluginError
from palpate.flags import FlagMeaning
from palpate.offers import import_target
from palpate.plugin_origin import Plugin, normalized_name

if TYPE_CHECKING:
    from palpate.parts import Part


@dataclass(frozen=True)
class Entry:
    """One part that can be named in a pipeline."""

    name: str
    offered: type[Part] | str  # or "module:Class", which is imported when it is asked for
    plugin: Plugin
    root: type[Part]

    @property
    def qualified(self) -> str:
        """Return the name that means this part on every machine: that of a third party has its distribution."""
        return self.name if self.plugin.own else self.plugin.qualified(self.name)

    @cached_property
    def part(self) -> type[Part]:
        """The part; raises PluginError where the plugin's name of it cannot be imported or is not a part."""
        try:
            part: Any = import_target(self.offered) if isinstance(self.offered, str) else self.offered
        except PluginError as error:
            raise PluginError(f"plugin {self.plugin.name}: {self.name!r}: {error}") from error
        if not (isinstance(part, type) and issubclass(part, self.root)):
            raise PluginError(
                f"plugin {self.plugin.name}: {self.name!r} ({self.offered}) is not of kind {self.root.__name__}"
            )
        if missing := missing_methods(part):
            raise PluginError(f"plugin {self.plugin.name}: {self.name!r} ({part.__name__}) does not define {missing}")
        return part

    @cached_property
    def problem(self) -> str | None:
        """The reason why the part cannot be used; None if it can."""
        try:
            _ = self.part
        except PluginError as error:
            return str(error)
        return None

    def is_of(self, part: type[Part]) -> bool:
        """Return True if this is the entry of a part; imports nothing of another name."""
        if isinstance(self.offered, str):
            return self.offered.rpartition(":")[2] == part.__qualname__ and self.part is part
        return self.offered is part


@dataclass(frozen=True)
class FlagEntry:
    """The meaning of a flag's code, and the plugin that registered it."""

    meaning: FlagMeaning
    plugin: Plugin


def full_name(entries: Mapping[str, Entry], name: str) -> str:
    """Return the key of a part, from it, its qualified name or initials that only one has; empty if it matches none."""
    if name in entries:
        return name
    distribution, colon, short = name.partition(":")
    if not colon:
        return unique_initials(entries).get(name, "")
    qualified = f"{normalized_name(distribution)}:{short}"
    return next((key for key, entry in entries.items() if entry.plugin.qualified(entry.name) == qualified), "")


def unique_initials(entries: Mapping[str, Entry]) -> dict[str, str]:
    """Return keys by initials that only one has, such as "dr"; palpate's own parts come before those of others."""
    keys: dict[str, str] = {}
    for is_own in (False, True):
        by_initials: dict[str, list[str]] = {}
        for key, entry in entries.items():
            if "-" in key and ":" not in key and entry.plugin.own == is_own:
                by_initials.setdefault("".join(part[:1] for part in key.split("-")), []).append(key)
        keys |= {initials: same[0] for initials, same in by_initials.items() if len(same) == 1}
    return keys


def resolve_older_name(entries: dict[str, Entry], name: str, is_number: bool) -> tuple[str, str]:
    """Let a name that palpate has added mean what it meant before, in the entries of a kind.

    It means the part of the one third party that offers the name where only a number (`is_number`) depends on it, and
    nothing otherwise, since a wrong choice may move an arm. Return what it means and why it is refused; empty texts
    where no third party offers it.
    """
    shipped = entries.get(name)
    foreign_entries = [entry for entry in entries.values() if entry.name == name and not entry.plugin.own]
    if shipped is None or not foreign_entries:
        return "", ""
    entries[shipped.plugin.qualified(name)] = entries.pop(name)
    if is_number and len(foreign_entries) == 1:
        entries[name] = foreign_entries[0]
        return f"it means {foreign_entries[0].qualified!r} of plugin {foreign_entries[0].plugin.name}", ""
    choices = [*(entry.qualified for entry in foreign_entries), shipped.plugin.qualified(name)]
    return "", f"write {' or '.join(map(repr, choices))}"


def version_number(text: str) -> tuple[int, ...]:
    """Return MAJOR and MINOR of a version."""
    return tuple(int(number) for number in text.split(".")[:2])
