"""A command on a folder of fits, as words, as a line for a shell, and read back from it."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from palpate import ConfigurationError

OUT = "$out"  # stands for the folder
PLACES = ("--out", "--picture", "--pipeline")  # options whose value is a place in the folder
_COMMANDS = ("repeat review", "repeat", "fit choose", "fit", "report", "map")
_FLAGS = ("--no-refit", "--each", "--json")  # options without a value


@dataclass(frozen=True)
class Action:
    """A command on the folder: its words, and its options with their values."""

    command: str
    options: tuple[tuple[str, str], ...] = ()  # the value of a flag is empty
    source: str = OUT

    @property
    def text(self) -> str:
        """The command line, for a shell that knows the folder as ``$out``."""
        return " ".join(_words(self, f'"{OUT}"', shlex.quote))

    def text_for(self, folder: str) -> str:
        """Return the command line for a folder."""
        return " ".join(_words(self, shlex.quote(folder), shlex.quote))

    def words(self, folder: str) -> list[str]:
        """Return the words of the command for a folder, without ``palpate``."""
        return list(_words(self, folder, str))[1:]

    @classmethod
    def of(cls, text: str) -> Action:
        """Return the action of a command line that `text` has written; raises ConfigurationError for any other."""
        try:
            words = shlex.split(text)
        except ValueError as error:
            raise ConfigurationError(f"{text!r}: is not a command line: {error}") from error
        command = next((name for name in _COMMANDS if words[1 : 1 + len(name.split())] == name.split()), "")
        rest = words[1 + len(command.split()) :]
        if words[:1] != ["palpate"] or not command or not rest or rest[0].startswith("-"):
            raise ConfigurationError(f"{text!r}: is not a command of the page")
        return cls(command, tuple(_options(rest[1:])), rest[0])


def where_curve(name: str) -> str:
    """Return the filter words of one curve."""
    return shlex.join([f"curve={name}"])


def _words(action: Action, folder: str, quoted: Callable[[str], str]) -> Iterator[str]:
    yield from ("palpate", *action.command.split())
    source = f"./{action.source}" if action.source.startswith("-") else action.source
    yield folder if source == OUT else quoted(source)
    for option, value in action.options:
        if option in _FLAGS:
            yield option
        elif option in PLACES and (value == OUT or value.startswith(f"{OUT}/")):
            yield from (option, folder + (quoted(value[len(OUT) :]) if value != OUT else ""))
        elif value[:1] in ("", "-"):  # it is to be no option, such as --plugin=FILE.py
            yield f"{option}={quoted(value)}"
        else:
            yield from (option, quoted(value))


def _options(words: list[str]) -> Iterator[tuple[str, str]]:
    """Options with their values; raises ConfigurationError."""
    left = iter(words)
    for word in left:
        option, equals, value = word.partition("=")
        if not option.startswith("--") or (equals and option in _FLAGS):
            raise ConfigurationError(f"{word!r}: is not an option of a command of the page")
        yield option, value if equals or option in _FLAGS else next(left, "")
