"""Whether the plugin files that a pipeline names may be executed: said, refused, or asked about once."""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path

from palpate.errors import OutputError, PluginError
from palpate.writing import write_whole

SWITCH = "PALPATE_PLUGINS"  # environment variable: "off" refuses every plugin file of a pipeline

# What the command at work has said already; None where no command is at work, as in a notebook or a worker.
_said: ContextVar[set[Path] | None] = ContextVar("_said", default=None)


@contextmanager
def at_the_command_line() -> Iterator[None]:
    """Within the context, files are named before they are executed, and a person may be asked."""
    token = _said.set(set())
    try:
        yield
    finally:
        _said.reset(token)


def demand_trust(files: Iterable[Path], base: Path) -> None:
    """Raise PluginError for the first plugin file of a pipeline in folder `base` that must not be executed.

    A file beside the pipeline that is the user's own never raises a question; another one does once for its contents,
    and only on a terminal.
    """
    for file in files:
        if os.environ.get(SWITCH, "").lower() == "off":
            raise PluginError(f"plugin file {file} is not executed: --no-plugins or {SWITCH}=off forbids it")
        said = _said.get()
        if said is None or not file.is_file() or file.resolve() in said:
            continue
        said.add(file.resolve())
        _ask(file, base)
        print(f"executing plugin file {file}", file=sys.stderr)


def _ask(file: Path, base: Path) -> None:
    if not (sys.stdin is not None and sys.stdin.isatty() and sys.stderr.isatty()):
        return
    digest = hashlib.sha256(file.read_bytes()).hexdigest()
    known = _known()
    if digest in known:
        return
    beside = file.resolve().is_relative_to(base.resolve())
    own = file.stat().st_uid == os.getuid()
    if not (beside and own):
        why = "lies outside of the pipeline's folder" if not beside else "belongs to another user"
        print(f"plugin file {file} {why}; a plugin can do all that you can. Execute it? [y/N] ", file=sys.stderr)
        if sys.stdin.readline().strip().lower() not in ("y", "yes"):
            raise PluginError(f"plugin file {file} is not executed: it was refused")
    with suppress(OSError, OutputError):  # then it asks again
        _record().parent.mkdir(parents=True, exist_ok=True)
        write_whole(_record(), "".join(f"{line}\n" for line in sorted({*known, digest})))


def _record() -> Path:
    state = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(state) / "palpate" / "trusted-plugins"


def _known() -> set[str]:
    """Hashes of the files that were executed with consent."""
    try:
        return set(_record().read_text(encoding="utf-8").split())
    except (OSError, UnicodeDecodeError):
        return set()
