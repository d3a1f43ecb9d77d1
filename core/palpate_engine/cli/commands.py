"""Choice of the command that is meant; nothing of a command is imported for that."""

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
_FIRST_COMMANDS = (  # what somebody has, and the first command for it
    ("A folder of curves:", 'palpate fit FOLDER --tip "sphere 3 mm"'),
    ("A log:", "palpate info LOG --suggest -o log.toml, then palpate run log.toml"),
    ("A robot:", "palpate init ur3e, then palpate rehearse ur3e.toml: nothing real moves"),
    ("Nothing yet:", "palpate init point, then palpate run point.toml: a simulated rig"),
    ("Arrays in Python:", "import palpate, then palpate.record(...) and palpate.fit(...)"),
)
_USAGE = "usage: palpate [--plugin FILE.py]... [--no-plugins] COMMAND [ARGUMENT]..."
_OTHER = "analyse"  # the task of a plugin's command that names none of ours
_HELP = ("-h", "--help")
_NEARLY = 0.75  # ratio of equal letters (difflib), from which a word is a slip: a choice
_INDENT, _MAX_WIDTH, _MIN_TEXT = 14, 110, 20  # columns of the help's tables: a choice


@dataclass(frozen=True)
class Invocation:
    """Request of a command line."""

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
    """Return what the arguments ask for; raises ConfigurationError for an unknown option."""
    if not arguments:
        return Invocation("start")
    remaining, files, forbids = *_without_plugin_files(arguments), False
    while remaining and remaining[0].startswith("-"):
        option = remaining.pop(0)
        if option in _HELP:
            return Invocation("help", files=tuple(files))
        if option == "--version":
            return Invocation("version")
        if option == "--no-plugins":
            forbids = True
            continue
        raise ConfigurationError(f"{option}: is not an option before a command; {_USAGE}")
    if not remaining:
        return Invocation("help", files=tuple(files))
    return Invocation("command", tuple(remaining), tuple(files), forbids)


def _without_plugin_files(arguments: Sequence[str]) -> tuple[list[str], list[Path]]:
    """Return the arguments without ``--plugin FILE``, which may stand anywhere, and the files.

    The file's name must end in .py behind a command, where ``palpate init --plugin tip`` means something else.
    Raises ConfigurationError where it may be a file that a pattern of the shell, such as ``*``, has found.
    """
    remaining, files = list[str](), list[Path]()
    pending = list(arguments)
    while pending:
        argument = pending.pop(0)
        option, _, value = argument.partition("=")
        follows = option == "--plugin" and not value and bool(pending)
        text = pending[0] if follows else value
        if option == "--plugin" and (text.endswith(".py") or (text and not remaining)):
            if Path(argument).exists():
                raise ConfigurationError(
                    f"{argument}: there is a file of this name here: write ./{argument} to name it"
                )
            files.append(Path(text))
            del pending[:follows]  # the file, where it is a word of its own
        else:
            remaining.append(argument)
    return remaining, files


def call_of(invocation: Invocation) -> CommandCall:
    """Return the command that is meant, a subcommand before a command; raises PluginError where no plugin has it."""
    registry = command_offers()
    first, *arguments = invocation.words
    subcommands = registry.subcommands(first)
    if arguments and (sentence := registry.ambiguous.get(("command", f"{first} {arguments[0]}"))):
        raise PluginError(sentence)
    if arguments and arguments[0] in subcommands:
        return CommandCall(f"{first} {arguments[0]}", subcommands[arguments[0]], tuple(arguments[1:]), {})
    if subcommands and arguments and arguments[0] not in _HELP:
        _demand_no_slip(first, arguments[0], subcommands, alone=first not in registry.commands)
    if subcommands and first not in registry.commands:
        return CommandCall(first, None, tuple(arguments), subcommands)
    return CommandCall(first, registry.command(first), tuple(arguments), subcommands)


def _demand_no_slip(first: str, name: str, subcommands: Mapping[str, Command], alone: bool) -> None:
    """Raise PluginError where a word is not a subcommand, and can be nothing else or nearly is one."""
    if alone or (get_close_matches(name, subcommands, cutoff=_NEARLY) and not Path(name).exists()):
        raise PluginError(f"no command '{first} {name}'{suggest(name, subcommands)}")


def command_offers() -> Registry:
    """Return the commands of all plugins; raises PluginError where two claim one name."""
    from palpate.registry import load_commands

    return load_commands()


def version_text() -> str:
    """Return ``palpate 0.1.0``."""
    import importlib.metadata

    return f"palpate {importlib.metadata.version('palpate')}"


def start_text() -> str:
    """Return what to type first, by what somebody has; only commands that are installed."""
    offers = command_offers().commands
    missing = {"fit", "info", "init"} - {name.partition(" ")[0] for name in offers}
    lines = [f"{task:<19} {command}" for task, command in _FIRST_COMMANDS if command.split()[1] not in missing]
    last = "palpate --help lists every command; palpate COMMAND --help says more."
    return "\n".join([_PURPOSE, "", *lines, "", last])


def help_text() -> str:
    """Return the usage, and every command with its line, by task; of subcommands the words."""
    registry = command_offers()
    lines = [
        _USAGE,
        "",
        _PURPOSE,
    ]
    for panel, title in PANELS.items():
        rows = dict[str, str]()
        for name, command in registry.commands.items():
            first_word = name.partition(" ")[0]
            # Subcommands are shown by their first word, unless that is a command itself.
            is_shown = not command.hidden and (name == first_word or first_word not in registry.commands)
            if is_shown and (command.panel if command.panel in PANELS else _OTHER) == panel:
                rows[first_word] = _line(first_word, registry)
        lines += ["", f"{title}:", *_table(rows)] if rows else []
    lines += [
        "",
        "palpate alone says what to type first; palpate COMMAND --help says more, and shows subcommands.",
        "--plugin FILE.py, anywhere on the line, adds what a file of yours offers: commands, parts, flags.",
    ]
    lines += registry.notices
    return "\n".join(lines)


def group_text(call: CommandCall) -> str:
    """Return usage and lines of subcommands whose first word has no command of its own."""
    rows = {name: command.help for name, command in call.subcommands.items()}
    lines = [f"usage: palpate {call.name} COMMAND [ARGUMENT]...", "", *_table(rows), ""]
    return "\n".join([*lines, f"palpate {call.name} COMMAND --help says more."])


def epilog(call: CommandCall) -> str | None:
    """Return what the help of a command says of its subcommands, as Markdown."""
    rows = [f"- `palpate {call.name} {name}`: {command.help}" for name, command in call.subcommands.items()]
    lines = ["Subcommands:", *rows] if rows else []
    if call.command is not None and call.command.first_options:
        lines.append(f"`palpate {call.name} --help all` shows every option.")
    return "\n\n".join(lines) or None


def is_hidden(call: CommandCall, names: Sequence[str]) -> bool:
    """Return True if the help of a command leaves a parameter of such names out; arguments are always shown."""
    first = call.command.first_options if call.command is not None else ()
    asks_for_all = any(argument in _HELP and following == "all" for argument, following in pairwise(call.arguments))
    return bool(first) and not asks_for_all and names[0].startswith("-") and not set(names) & {*first, *_HELP}


def demand_no_former_option(call: CommandCall) -> None:
    """Raise ConfigurationError for an option that other words have replaced."""
    former = call.command.former_options if call.command is not None else {}
    for argument in call.arguments:
        if argument in former:
            raise ConfigurationError(f"{argument}: palpate {call.name} {argument} is {former[argument]} now")


def _line(name: str, registry: Registry) -> str:
    below = registry.subcommands(name)
    if name not in registry.commands:
        return " ".join(f"{subcommand}: {command.help}" for subcommand, command in below.items())
    also = f" Also: {', '.join(below)}." if below else ""
    return registry.commands[name].help + also


def _table(rows: Mapping[str, str]) -> list[str]:
    """Return the lines of a table of names and texts, as wide as the terminal."""
    width = max(min(shutil.get_terminal_size().columns, _MAX_WIDTH), _INDENT + _MIN_TEXT)
    name_width = _INDENT - len("   ")  # two spaces before a name, one behind it
    lines: list[str] = []
    for name, text in rows.items():
        head = f"  {name:<{name_width}} "
        lines += textwrap.wrap(text, width, initial_indent=head, subsequent_indent=" " * _INDENT)
    return lines
