"""Runs in groups by patterns of their names, in the natural order."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from palpate import ConfigurationError


def natural(name: Path | str) -> list[tuple[int, str]]:
    """Return a key that sorts run_2 before run_10."""
    return [(int(part), "") if part.isdigit() else (0, part) for part in re.split(r"(\d+)", str(name)) if part]


def groups_of(runs: Sequence[Path], patterns: Sequence[str]) -> dict[str, list[Path]]:
    """Return the run folders by group: `runs` as one group, and one for each pattern "NAME=PATTERN" of paths.

    Each group is in the natural order of names, so that no order of arguments matters. Raises ConfigurationError.
    """
    groups: dict[str, list[Path]] = {"runs": list(runs)} if runs else {}
    for text in patterns:
        name, equals, pattern = text.partition("=")
        if not (name and equals and pattern):
            raise ConfigurationError(f'--group {text}: write NAME=PATTERN, such as soft="runs/soft_*"')
        base = Path(pattern).anchor or "."
        paths = list(Path(base).glob(str(Path(pattern).relative_to(base)) if Path(pattern).anchor else pattern))
        if not paths:
            raise ConfigurationError(f"--group {text}: nothing matches {pattern!r}")
        groups[name] = [*groups.get(name, []), *paths]
    if not groups:
        raise ConfigurationError("name at least one run folder, or a --group NAME=PATTERN")
    return {name: sorted(set(paths), key=natural) for name, paths in groups.items()}
