"""Names that plugins claim: a shipped name is palpate's, and one of several others is the short form of none."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from palpate import hooks
from palpate.errors import PluginError
from palpate.plugin_origin import Plugin

CORE_TABLES = ("run", "alignment", "safety")
_RESERVED = {"table": frozenset({*CORE_TABLES, "palpate", "dialect", *hooks.PART_KINDS})}
_NAMED_BY_USERS = frozenset({"command", *hooks.PART_KINDS})  # kinds in which DISTRIBUTION:NAME can be asked for

Offer = tuple[Any, Plugin]


@dataclass
class Claims:
    """The offers of one kind by the name that reaches each, and what became of names that several plugins claim."""

    kind: str
    offers: dict[str, Offer] = field(default_factory=dict)
    ambiguous: dict[str, str] = field(default_factory=dict)  # names without an owner: the sentence for who uses one
    notices: list[str] = field(default_factory=list)

    def settle(self, name: str, offers: list[Offer]) -> None:
        """Find the owner of a name that these plugins claim, and the names by which the others are reached."""
        shipped = [offer for offer in offers if offer[1].own]
        foreign_offers = [offer for offer in offers if not offer[1].own]
        is_reserved = bool(shipped) or name in _RESERVED.get(self.kind, ())
        self._demand_free(name, shipped, foreign_offers, is_reserved)
        if shipped:
            self.offers[name] = shipped[0]
        if is_reserved:
            self._set_aside(name, foreign_offers)
        elif len(foreign_offers) == 1:
            self.offers[name] = foreign_offers[0]
        else:
            self._qualify(name, foreign_offers)

    def _set_aside(self, name: str, offers: list[Offer]) -> None:
        """Leave out offers whose name is palpate's; what users ask for is reached by its qualified name."""
        reached = _by_qualified_name(name, offers) if self.kind in _NAMED_BY_USERS else {}
        self.offers |= reached
        for _, plugin in offers:
            qualified = plugin.qualified(name)
            where = f"this one is {qualified!r}" if qualified in reached else "this one is left out"
            self.notices.append(f"plugin {plugin.name}: {self.kind} {name!r} is a name of palpate's own; {where}")

    def _qualify(self, name: str, offers: list[Offer]) -> None:
        """Reach each of several third parties' offers of one name by its qualified name alone."""
        reached = _by_qualified_name(name, offers)
        self.offers |= reached
        sentence = f"{self.kind} {name!r} is claimed by {' and '.join(plugin.name for _, plugin in offers)}"
        if self.kind in _NAMED_BY_USERS and reached:
            sentence += f"; write {' or '.join(repr(text) for text in reached)}"
        self.ambiguous[name] = sentence
        self.notices.append(sentence)

    def _demand_free(self, name: str, shipped: list[Offer], foreign_offers: list[Offer], is_reserved: bool) -> None:
        """Raise PluginError where palpate claims a name twice, or a file, which its user can correct, a taken one."""
        files = [plugin for _, plugin in foreign_offers if plugin.is_file]
        claimants = [plugin.name for _, plugin in shipped]
        if is_reserved:
            claimants = [*(claimants or ["palpate itself"]), *(file.name for file in files)]
        elif len({file.distribution for file in files}) < len(files):
            claimants = [file.name for file in files]
        if len(claimants) > 1:
            raise PluginError(f"{self.kind} {name!r} is claimed by two plugins: {claimants[0]} and {claimants[1]}")


def _by_qualified_name(name: str, offers: list[Offer]) -> dict[str, Offer]:
    """Return offers of one name by ``DISTRIBUTION:NAME``, without those that one distribution makes twice."""
    qualified = [plugin.qualified(name) for _, plugin in offers]
    return {text: offer for text, offer in zip(qualified, offers, strict=True) if qualified.count(text) == 1}


def settle_claims(kind: str, offers: Iterable[tuple[Plugin, Mapping[str, Any]]]) -> Claims:
    """Return the owner of every name of a kind.

    palpate's own distribution keeps its names. An offer of another plugin with such a name is left out; a part or a
    command is reached as ``DISTRIBUTION:NAME``. Of several third parties with one name each is reached in that way
    alone. Raises PluginError where a plugin file, which its user can correct, claims a shipped name.
    """
    by_name: dict[str, list[Offer]] = {}
    for plugin, items in offers:
        for name, item in items.items():
            by_name.setdefault(name, []).append((item, plugin))
    claims = Claims(kind)
    for name, claimants in by_name.items():
        claims.settle(name, claimants)
    return claims
