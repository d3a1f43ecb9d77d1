"""The origin of parts: an installed distribution's entry point, or a file."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Plugin:
    """The origin of parts: a distribution's entry point, or a file."""

    name: str  # "palpate-punch 1.0 (punch)" or the file's path
    place: str = ""  # file of its module
    own: bool = False  # of palpate's own distribution
    digest: str = ""  # SHA-256 of what was executed, of a file
    api: int | None = None  # number of the interface that it states

    @property
    def is_file(self) -> bool:
        """True for a file that the user names; else the plugin is installed."""
        return bool(self.digest)

    @property
    def distribution(self) -> str:
        """Return the normalized name of its distribution, or that of its file without ``.py``."""
        return normalized_name(Path(self.name).stem if self.is_file else self.name.partition(" ")[0])

    @property
    def version(self) -> str:
        """Return the version of its distribution; empty of a file."""
        return "" if self.is_file else self.name.partition(" ")[2].partition(" ")[0]

    def qualified(self, name: str) -> str:
        """Return ``DISTRIBUTION:NAME``, which means its own offer of a name on every machine."""
        return f"{self.distribution}:{name}"

    def holds(self, file: str) -> bool:
        """Return True for its own file and, of a package, for every file in that package."""
        is_package = Path(self.place).name == "__init__.py"
        return file == self.place or (is_package and Path(file).is_relative_to(Path(self.place).parent))


def normalized_name(distribution: str) -> str:
    """Return a distribution's name as package indexes compare it (PEP 503)."""
    return re.sub(r"[-_.]+", "-", distribution).lower()
