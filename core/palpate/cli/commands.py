"""Which command is meant, and what there is; nothing of a command is imported for that."""

from __future__ import annotations

import shutil
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from palpate.errors import ConfigurationError
from palpate.extensions import PANELS, Command

if TYPE_CHECKING:
    from palpate.registry import Registry

_USAGE = "usage: palpate [--plugin FILE]... [--no-plugins] COMMAND [ARGUMENT]..."


@dataclass(frozen=True)
class Invocation:
    """What the command line asks for."""

    wants: Literal["help", "version", "command"]
    name: str = ""
    arguments: tuple[str, ...] = ()
    files: tuple[Path, ...] = ()  # plugins beside those that are installed
    forbids: bool = False  # plugin files that a pipeline names

    def command(self) -> Command:
        """The command; raises PluginError where no plugin has it."""
        return offered(self.files).command(self.name)


def parsed(arguments: Sequence[str]) -> Invocation:
    """What the arguments ask for; raises ConfigurationError for an option that is none."""
    rest, files, forbids = list(arguments), list[Path](), False
    while rest and rest[0].startswith("-"):
        word = rest.pop(0)
        if word in ("-h", "--help"):
            return Invocation("help", files=tuple(files))
        if word == "--version":
            return Invocation("version")
        if word == "--no-plugins":
            forbids = True
            continue
        if word != "--plugin" or not rest:
            raise ConfigurationError(f"{word}: is no option before a command; {_USAGE}")
        files.append(Path(rest.pop(0)))
    if not rest:
        return Invocation("help", files=tuple(files))
    return Invocation("command", rest[0], tuple(rest[1:]), tuple(files), forbids)


def offered(files: Sequence[Path] = ()) -> Registry:
    """The commands of all plugins; raises PluginError where two claim one name."""
    from palpate.registry import load_commands

    return load_commands(files)


def version_text() -> str:
    """``palpate 0.1.0``."""
    import importlib.metadata

    return f"palpate {importlib.metadata.version('palpate')}"


def help_text(files: Sequence[Path] = ()) -> str:
    """Usage, and every command with its line, by panels."""
    registry = offered(files)
    width = min(shutil.get_terminal_size().columns, 110)
    indent = max(len(name) for name in registry.commands) + 4
    lines = [
        _USAGE,
        "",
        "Elasticity and viscosity of soft material from robotic palpation, each with its uncertainty.",
    ]
    for panel, title in PANELS.items():
        rows = {name: command.help for name, command in registry.commands.items() if command.panel == panel}
        lines += ["", f"{title}:"] if rows else []
        for name, text in rows.items():
            head = f"  {name:<{indent - 2}}"
            lines += textwrap.wrap(text, max(width, indent + 20), initial_indent=head, subsequent_indent=" " * indent)
    lines += ["", "palpate COMMAND --help says more of a command; palpate --version prints the version."]
    lines += [f"plugin {plugin} could not be loaded: {reason}" for plugin, reason in registry.failures.items()]
    return "\n".join(lines)
