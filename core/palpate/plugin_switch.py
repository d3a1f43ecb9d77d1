"""The environment variable PALPATE_PLUGINS: the distributions, besides palpate's own, that take part."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

from palpate.errors import suggest
from palpate.plugin_origin import normalized_name

SWITCH = "PALPATE_PLUGINS"
OFF = "off"  # no other distribution, and no plugin file of a pipeline


@dataclass(frozen=True)
class PluginSwitch:
    """The text of PALPATE_PLUGINS: names of distributions, `off`, or nothing, with which all take part."""

    text: str

    @classmethod
    def of_environment(cls) -> PluginSwitch:
        """Return that of this process."""
        return cls(os.environ.get(SWITCH, "").strip())

    @property
    def is_off(self) -> bool:
        """Return True where no plugin but palpate's own takes part."""
        return self.text.lower() == OFF

    @property
    def distributions(self) -> frozenset[str]:
        """Return the normalized names of the distributions that it names."""
        names = [] if self.is_off else self.text.replace(",", " ").split()
        return frozenset(map(normalized_name, names))

    def admits(self, distribution: str) -> bool:
        """Return True for a third party's distribution that takes part."""
        return not self.text or distribution in self.distributions

    def left_out(self, installed: Mapping[str, str]) -> tuple[str, ...]:
        """Return a sentence for each plugin that takes no part, and for each name that no distribution has.

        `installed` holds the distributions of third parties by the names of their plugins.
        """
        absent = [name for name, distribution in installed.items() if not self.admits(distribution)]
        distributions = {*installed.values(), "palpate"}
        unknown = sorted(self.distributions - distributions)
        return (
            *(f"plugin {name} is left out: {SWITCH} is {self.text!r}" for name in absent),
            *(
                f"{SWITCH} names {name!r}, which is not installed with plugins{suggest(name, distributions)}"
                for name in unknown
            ),
        )


@contextmanager
def only_plugins(text: str | None) -> Iterator[None]:
    """Within the context, and in processes that are started in it, PALPATE_PLUGINS is `text`; None leaves it alone."""
    before = os.environ.get(SWITCH)
    if text is not None:
        os.environ[SWITCH] = text
    try:
        yield
    finally:
        if text is not None:
            os.environ.pop(SWITCH)
            os.environ.update({SWITCH: before} if before is not None else {})
