"""Which command is meant, and what there is; nothing of a command is imported for that."""

from __future__ import annotations

import shutil
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from palpate.errors import ConfigurationError, PluginError, suggest
from palpate.offers import PANELS, Command

if TYPE_CHECKING:
    from palpate.registry import Registry

_PURPOSE = "Elasticity and viscosity of soft material from robotic palpation, each with its uncertainty."
_FIRST = (  # what somebody has, and the first command for it
    ("A folder of curves:", 'palpate fit FOLDER --tip "sphere 3 mm"'),
    ("A log:", "palpate info LOG --suggest -o log.toml, then palpate run log.toml"),
    ("A robot:", "palpate init ur3e, then palpate rehearse ur3e.toml: nothing real moves"),
    ("Nothing yet:", "palpate init point, then palpate run point.toml: a simulated rig"),
    ("Arrays in Python:", "import palpate, then palpate.record(...) and palpate.fit(...)"),
)
_USAGE = "usage: palpate [--plugin FILE.py]... [--no-plugins] COMMAND [ARGUMENT]..."
_OTHER = "analyse"  # the task of a plugin's command that names none of ours
_HELP = ("-h", "--help")


@dataclass(frozen=True)
class Invocation:
    """What the command line asks for."""

    wants: Literal["start", "help", "version", "command"]
    words: tuple[str, ...] = ()  # the command and its arguments
    files: tuple[Path, ...] = ()  # plugins in addition to the installed ones
    forbids: bool = False  # plugin files that a pipeline names


@dataclass(frozen=True)
class CommandCall:
    """A command with its arguments."""

    name: str
    command: Command | None  # None for the first word of subcommands that has no command of its own
    arguments: tuple[str, ...]
    subcommands: Mapping[str, Command]


def parse_arguments(arguments: Sequence[str]) -> Invocation:
    """What the arguments ask for; raises ConfigurationError for an unknown option."""
    if not arguments:
        return Invocation("start")
    rest, files, forbids = *_without_plugin_files(arguments), False
    while rest and rest[0].startswith("-"):
        word = rest.pop(0)
        if word in _HELP:
            return Invocation("help", files=tuple(files))
        if word == "--version":
            return Invocation("version")
        if word == "--no-plugins":
            forbids = True
            continue
        raise ConfigurationError(f"{word}: is not an option before a command; {_USAGE}")
    if not rest:
        return Invocation("help", files=tuple(files))
    return Invocation("command", tuple(rest), tuple(files), forbids)


def _without_plugin_files(arguments: Sequence[str]) -> tuple[list[str], list[Path]]:
    """Return the arguments without ``--plugin FILE``, which may stand anywhere, and the files.

    The file's name must end in .py behind a command, where ``palpate init --plugin tip`` means something else.
    Raises ConfigurationError where it may be a file that a pattern of the shell, such as ``*``, has found.
    """
    rest, files = list[str](), list[Path]()
    words = list(arguments)
    while words:
        given = words.pop(0)
        word, _, value = given.partition("=")
        follows = word == "--plugin" and not value and bool(words)
        text = words[0] if follows else value
        if word == "--plugin" and (text.endswith(".py") or (text and not rest)):
            if Path(given).exists():
                raise ConfigurationError(f"{given}: there is a file of this name here: write ./{given} to name it")
            files.append(Path(text))
            del words[:follows]
        else:
            rest.append(given)
    return rest, files


def call_of(invocation: Invocation) -> CommandCall:
    """Return the command that is meant, a subcommand before a command; raises PluginError where no plugin has it."""
    registry = command_offers()
    first, *rest = invocation.words
    below = registry.subcommands(first)
    if rest and (sentence := registry.ambiguous.get(("command", f"{first} {rest[0]}"))):
        raise PluginError(sentence)
    if rest and rest[0] in below:
        return CommandCall(f"{first} {rest[0]}", below[rest[0]], tuple(rest[1:]), {})
    if below and rest and rest[0] not in _HELP:
        _demand_no_slip(first, rest[0], below, alone=first not in registry.commands)
    if below and first not in registry.commands:
        return CommandCall(first, None, tuple(rest), below)
    return CommandCall(first, registry.command(first), tuple(rest), below)


def _demand_no_slip(first: str, word: str, below: Mapping[str, Command], alone: bool) -> None:
    """Raise PluginError where a word is not a subcommand, and can be nothing else or nearly is one."""
    if alone or (get_close_matches(word, below, cutoff=0.75) and not Path(word).exists()):
        raise PluginError(f"no command '{first} {word}'{suggest(word, below)}")


def command_offers() -> Registry:
    """Return the commands of all plugins; raises PluginError where two claim one name."""
    from palpate.registry import load_commands

    return load_commands()


def version_text() -> str:
    """``palpate 0.1.0``."""
    import importlib.metadata

    return f"palpate {importlib.metadata.version('palpate')}"


def start_text() -> str:
    """What to type first, by what somebody has; only commands that are installed."""
    offers = command_offers().commands
    missing = {"fit", "info", "init"} - {name.partition(" ")[0] for name in offers}
    lines = [f"{task:<19} {command}" for task, command in _FIRST if command.split()[1] not in missing]
    last = "palpate --help lists every command; palpate COMMAND --help says more."
    return "\n".join([_PURPOSE, "", *lines, "", last])


def help_text() -> str:
    """Usage, and every command with its line, by task; of subcommands the words."""
    registry = command_offers()
    lines = [
        _USAGE,
        "",
        _PURPOSE,
    ]
    for panel, title in PANELS.items():
        rows = {
            name.partition(" ")[0]: _line(name.partition(" ")[0], registry)
            for name, command in registry.commands.items()
            if not command.hidden
            and (command.panel if command.panel in PANELS else _OTHER) == panel
            and (" " not in name or name.partition(" ")[0] not in registry.commands)
        }
        lines += ["", f"{title}:", *_table(rows)] if rows else []
    lines += [
        "",
        "palpate alone says what to type first; palpate COMMAND --help says more, and shows subcommands.",
        "--plugin FILE.py, anywhere on the line, adds what a file of yours offers: commands, parts, flags.",
    ]
    lines += registry.notices
    return "\n".join(lines)


def group_text(call: CommandCall) -> str:
    """Usage and lines of subcommands whose first word has no command of its own."""
    rows = {name: command.help for name, command in call.subcommands.items()}
    lines = [f"usage: palpate {call.name} COMMAND [ARGUMENT]...", "", *_table(rows), ""]
    return "\n".join([*lines, f"palpate {call.name} COMMAND --help says more."])


def epilog(call: CommandCall) -> str | None:
    """What the help of a command says of its subcommands, as Markdown."""
    rows = [f"- `palpate {call.name} {name}`: {command.help}" for name, command in call.subcommands.items()]
    lines = ["Subcommands:", *rows] if rows else []
    if call.command is not None and call.command.first_options:
        lines.append(f"`palpate {call.name} --help all` shows every option.")
    return "\n\n".join(lines) or None


def is_hidden(call: CommandCall, names: Sequence[str]) -> bool:
    """Return True if the help of a command leaves a parameter of such names out; arguments are always shown."""
    first = call.command.first_options if call.command is not None else ()
    every = any(word in _HELP and following == "all" for word, following in pairwise(call.arguments))
    return bool(first) and not every and names[0].startswith("-") and not set(names) & {*first, *_HELP}


def demand_no_former_option(call: CommandCall) -> None:
    """Raise ConfigurationError for an option that other words have replaced."""
    former = call.command.former_options if call.command is not None else {}
    for word in call.arguments:
        if word in former:
            raise ConfigurationError(f"{word}: palpate {call.name} {word} is {former[word]} now")


def _line(name: str, registry: Registry) -> str:
    below = registry.subcommands(name)
    if name not in registry.commands:
        return " ".join(f"{word}: {command.help}" for word, command in below.items())
    also = f" Also: {', '.join(below)}." if below else ""
    return registry.commands[name].help + also


def _table(rows: Mapping[str, str]) -> list[str]:
    indent = 14
    width = max(min(shutil.get_terminal_size().columns, 110), indent + 20)
    lines: list[str] = []
    for name, text in rows.items():
        head = f"  {name:<{indent - 3}} "
        lines += textwrap.wrap(text, width, initial_indent=head, subsequent_indent=" " * indent)
    return lines
