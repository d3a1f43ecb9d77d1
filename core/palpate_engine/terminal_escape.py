"""Standard output and error that no text can harm: control characters are escaped, what cannot be encoded is, too."""

from __future__ import annotations

import codecs
import contextlib
import io
import os
import re
import sys
from collections.abc import Iterator
from typing import Any, TextIO, cast

from palpate.errors import OutputError

# C0 but tab and newline, DEL, C1, and what turns the direction of writing.
_CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")
# What a terminal is sent on purpose: colours, cursor up, line erased, cursor hidden or shown, carriage return, bell.
_OWN = re.compile("(\x1b\\[[0-9;]{0,20}[mAK]|\x1b\\[\\?25[lh]|\r|\a)")


# What an encoding may lack, in its place; all else is escaped.
_PLAIN = {"µ": "u", "μ": "u", "±": "+-", "°": "deg", "Ω": "Ohm", "·": "*", "²": "^2", "–": "-", "…": "...", "×": "x"}


def _plainly(error: UnicodeError) -> tuple[str | bytes, int]:
    """Return the replacement of a character that an encoding lacks, and the place behind it; see
    `codecs.register_error`."""
    if isinstance(error, UnicodeEncodeError) and error.object[error.start] in _PLAIN:
        return _PLAIN[error.object[error.start]], error.start + 1
    return codecs.backslashreplace_errors(error)


codecs.register_error("palpate-plain", _plainly)


def _harmless(text: str) -> str:
    r"""Return a text with its control characters written out.

    >>> _harmless("a\x1b]0;b")
    'a\\x1b]0;b'
    """
    return _CONTROL.sub(lambda match: match[0].encode("unicode_escape").decode(), text)


class _Harmless:
    """A text stream that escapes control characters; on a terminal all but those that draw tables and progress."""

    def __init__(self, stream: TextIO, name: str) -> None:
        self._stream, self._name = stream, name
        self._failure: OutputError | None = None  # said again, since others try out a stream and go on
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="palpate-plain")

    def write(self, text: Any) -> int:
        """Write a text; raises OutputError where it cannot be written."""
        if not isinstance(text, str):  # so that a stream of texts differs from one of bytes
            raise TypeError(f"expected a text, not {type(text).__name__}")
        if not text:
            return 0
        parts = _OWN.split(text) if self._stream.isatty() else [text]
        safe = "".join(part if i % 2 else _harmless(part) for i, part in enumerate(parts))
        with self._reported_failure():
            self._stream.write(safe)
        return len(text)

    def flush(self) -> None:
        """Flush the stream; raises OutputError where it cannot be written."""
        with self._reported_failure():
            self._stream.flush()

    @contextlib.contextmanager
    def _reported_failure(self) -> Iterator[None]:
        """Within the context a failure to write becomes OutputError, which is raised again at every later attempt."""
        if self._failure is not None:
            raise self._failure
        try:
            yield
        except BrokenPipeError:
            raise
        except OSError as error:
            with contextlib.suppress(OSError, ValueError):  # else the interpreter tries once more at its end
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, self._stream.fileno())
                os.close(nowhere)
            self._failure = OutputError(f"{self._name}: cannot write: {error.strerror or error}")
            raise self._failure from error

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextlib.contextmanager
def harmless_output() -> Iterator[None]:
    """Within the context, nothing that is printed can steer a terminal, or fails for its encoding."""
    out, errors = _Harmless(sys.stdout, "standard output"), _Harmless(sys.stderr, "standard error")
    with contextlib.redirect_stdout(cast(TextIO, out)), contextlib.redirect_stderr(cast(TextIO, errors)):
        yield
