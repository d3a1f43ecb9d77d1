"""Texts and documents without the host and the paths they come from; file names stay."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

_ENDING = r"\.[A-Za-z][A-Za-z0-9]{0,7}"
# Within quotes a path may have blanks; it begins at a root, or ends in a file's name.
_QUOTED = re.compile(rf"""(["'])((?:~|\.{{1,2}}|[A-Za-z]:)?[/\\][^"'\n]*|[^"'\n]*[/\\][^"'\n/\\]+{_ENDING})\1""")
_BARE = re.compile(r"(?<![\w./~:-])(?:~|\.{1,2}|[A-Za-z]:)?(?:[/\\][\w.+@~-]+){2,}[/\\]?")
_FILE = re.compile(
    r"(?<![\w./~:-])[\w.+@~-]+(?:[/\\][\w.+@~-]+)*[/\\]([\w.+@~-]+\.(?:mcap|csv|toml|json|py|db3|gz|bag|yaml|txt))\b"
)
_MIN_LENGTH = 3  # characters of a host's name that is looked for in texts: a choice, shorter ones are words


def last_name(path: str) -> str:
    """Return the last name of a path of any system.

    >>> last_name("/home/jane/log.mcap")
    'log.mcap'
    """
    return re.split(r"[/\\]", path.rstrip("/\\"))[-1]


def without_paths(text: str, hosts: tuple[str, ...] = (), roots: tuple[str, ...] = ()) -> str:
    """Return a text in which every path is its last name, and no host is named.

    >>> without_paths('path = "/home/jane doe/log.mcap"  # on lab-7', ("lab-7",))
    'path = "log.mcap"  # on (host)'
    """
    for root in sorted(roots, key=len, reverse=True):
        text = text.replace(root, last_name(root))
    text = _QUOTED.sub(lambda match: f"{match[1]}{last_name(match[2])}{match[1]}", text)
    text = _FILE.sub(lambda match: match[1], _BARE.sub(lambda match: last_name(match[0]), text))
    for host in hosts:
        if len(host) >= _MIN_LENGTH:
            text = re.sub(rf"(?<!\w){re.escape(host)}(?!\w)", "(host)", text)
    return text


class Anonymous:
    """Takes host and paths of one run out of all that is shown of it."""

    def __init__(self, document: Mapping[str, Any], resolved: Mapping[str, Any], folder: Path) -> None:
        run = document.get("run", {})
        self._hosts = tuple(filter(None, [str(run.get("host") or "")]))
        named = [
            str(folder),
            str(folder.resolve()),
            str(Path.home()),
            os.getcwd(),
            *_paths(resolved),
            *_paths(document),
        ]
        self._roots = tuple(dict.fromkeys(path for path in named if len(path) > _MIN_LENGTH))

    def text(self, text: str) -> str:
        """Return a text without host and paths."""
        return without_paths(text, self._hosts, self._roots)

    def tree(self, value: Any) -> Any:
        """Return a document without host, command and paths."""
        if isinstance(value, Mapping):
            return {
                self.text(str(key)): self.tree(item) for key, item in value.items() if key not in ("host", "command")
            }
        if isinstance(value, list | tuple):
            return [self.tree(item) for item in value]
        if isinstance(value, str):
            return last_name(value) if _is_path(value) else self.text(value)
        return value


class Unchanged:
    """Shows all of a run as it is, with the methods of `Anonymous`."""

    def text(self, text: str) -> str:
        """Return the text."""
        return text

    def tree(self, value: Any) -> Any:
        """Return the document."""
        return value


def _is_path(text: str) -> bool:
    return bool(re.match(r"(~|\.{1,2}|[A-Za-z]:)?[/\\]", text)) and "\n" not in text


def _paths(value: Any) -> list[str]:
    """Return every text of a document that is a path."""
    if isinstance(value, Mapping):
        return [path for item in value.values() for path in _paths(item)]
    if isinstance(value, list | tuple):
        return [path for item in value for path in _paths(item)]
    return [value] if isinstance(value, str) and _is_path(value) else []
