"""Names and texts from files and plugins, made safe to print."""

from __future__ import annotations


def printable(text: str, lines: bool = False) -> str:
    """Return the text with every invisible character spelled out, so that it commands no terminal.

    It stays on one line, unless `lines` says that it may have several.

    >>> print(printable("/ft\\x1b[2J"))
    /ft\\u001b[2J
    """
    return "".join(c if c.isprintable() or (lines and c == "\n") else f"\\u{ord(c):04x}" for c in text)
