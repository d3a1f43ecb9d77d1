"""Commands on a folder of fits: as words, as a line for a shell, and parsed from such a line."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from palpate import ConfigurationError

OUT = "$out"  # in place of the folder
_PATH_OPTIONS = ("--out", "--picture", "--pipeline")  # whose value is a path in the folder
_COMMANDS = ("repeat review", "repeat", "fit choose", "fit", "report", "map")
_FLAGS = ("--no-refit", "--each", "--json")  # options without a value


@dataclass(frozen=True)
class Action:
    """Command of palpate on the folder, or on another `source`, with its options and their values."""

    command: str
    options: tuple[tuple[str, str], ...] = ()  # the value of a flag is empty
    source: str = OUT

    @property
    def text(self) -> str:
        """The command line, for a shell in which the variable ``out`` is the folder."""
        return " ".join(_words(self, f'"{OUT}"', quote=shlex.quote))

    def text_for(self, folder: str) -> str:
        """Return the command line for a folder."""
        return " ".join(_words(self, shlex.quote(folder), quote=shlex.quote))

    def words(self, folder: str) -> list[str]:
        """Return the words of the command for a folder, without ``palpate``."""
        return list(_words(self, folder, quote=str))[1:]

    @classmethod
    def of(cls, text: str) -> Action:
        """Return the action of a command line made by the property `text`; raises ConfigurationError for any other."""
        try:
            parsed_words = shlex.split(text)
        except ValueError as error:
            raise ConfigurationError(f"{text!r}: is not a command line: {error}") from error
        command = next((name for name in _COMMANDS if parsed_words[1 : 1 + len(name.split())] == name.split()), "")
        arguments = parsed_words[1 + len(command.split()) :]
        if parsed_words[:1] != ["palpate"] or not command or not arguments or arguments[0].startswith("-"):
            raise ConfigurationError(f"{text!r}: is not a command of the page")
        return cls(command, tuple(_options(arguments[1:])), source=arguments[0])


def where_curve(name: str) -> str:
    """Return the filter words of one curve."""
    return shlex.join([f"curve={name}"])


def _words(action: Action, folder: str, quote: Callable[[str], str]) -> Iterator[str]:
    """Yield the words of an action's command line, with `folder` in place of the mark OUT.

    `quote` quotes all words but the folder, which is quoted already.
    """
    yield from ("palpate", *action.command.split())
    source = f"./{action.source}" if action.source.startswith("-") else action.source
    yield folder if source == OUT else quote(source)
    for option, value in action.options:
        is_path = option in _PATH_OPTIONS and (value == OUT or value.startswith(f"{OUT}/"))
        if option in _FLAGS:
            yield option
        elif is_path:
            path_in_folder = value[len(OUT) :]
            yield option
            yield folder + (quote(path_in_folder) if path_in_folder else "")
        elif value[:1] in ("", "-"):  # with "=", so that the value is not taken for an option like --plugin=FILE.py
            yield f"{option}={quote(value)}"
        else:
            yield option
            yield quote(value)


def _options(arguments: list[str]) -> Iterator[tuple[str, str]]:
    """Yield options with their values, that of a flag empty; raises ConfigurationError."""
    remaining = iter(arguments)
    for argument in remaining:
        option, equals, value = argument.partition("=")
        if not option.startswith("--") or (equals and option in _FLAGS):
            raise ConfigurationError(f"{argument!r}: is not an option of a command of the page")
        if not equals and option not in _FLAGS:
            value = next(remaining, "")
        yield option, value
