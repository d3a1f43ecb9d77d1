"""Consent to plugin files: the content that may be executed, its approval, and the record of that."""

from __future__ import annotations

import os
import re
import shlex
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from palpate.errors import ConsentError, OutputError, PluginError
from palpate.plugin_switch import SWITCH, PluginSwitch
from palpate.printable_text import printable

NAMED = "PALPATE_NAMED_PLUGINS"  # environment variable: the files of `palpate --plugin FILE`, for its own processes

_LINE = re.compile(r"([0-9a-f]{64})(?:  (.*))?")  # of the record: as `sha256sum` writes it; older ones have no path


@dataclass(frozen=True)
class PluginFile:
    """A plugin file, read once: the content that is hashed is the content that is executed."""

    path: Path
    content: bytes

    @classmethod
    def read(cls, path: Path) -> PluginFile:
        """Return the file at a path; raises PluginError if it does not exist or is not Python source."""
        try:
            if not path.is_file():
                raise PluginError(f"plugin file {path} does not exist")
            if path.suffix != ".py":
                raise PluginError(f"plugin file {path} is not a Python file (.py)")
            return cls(path, path.read_bytes())
        except OSError as error:
            raise PluginError(f"plugin file {path} cannot be read: {error.strerror}") from error

    @cached_property
    def digest(self) -> str:
        """The SHA-256 of the content."""
        import hashlib  # as slow to import as ten other modules, and most commands have no plugin file

        return hashlib.sha256(self.content).hexdigest()


@dataclass
class _Consent:
    """The decisions so far, and the persons who can decide."""

    arguments: frozenset[str] | None = None  # of the command line; None where no command is at work
    places: frozenset[Path | None] = frozenset()  # of files among them
    inherited: bool = False  # in a worker, which decides nothing
    approved: set[str] = field(default_factory=set)  # SHA-256
    refused: set[str] = field(default_factory=set)
    announced: set[tuple[Path, str]] = field(default_factory=set)


# Modes of files (POSIX).
_OWNER_FOLDER, _OWNER_FILE, _WRITABLE_BY_OTHERS = 0o700, 0o600, 0o022

_PROCESS = _Consent()
_consent: ContextVar[_Consent] = ContextVar("_consent", default=_PROCESS)


@contextmanager
def at_the_command_line(arguments: Sequence[str] = ()) -> Iterator[None]:
    """Within the context a person is at work, who can be asked, and who has said what stands in `arguments`."""
    # Whole arguments, and the values of options; with their places, since a file may be named by any of these.
    parts = frozenset(part for argument in arguments for part in (argument, argument.partition("=")[2]) if part)
    with _deciding(_Consent(parts, frozenset(place for part in parts for place in _places(Path(part))))):
        yield


@contextmanager
def inherited_approval(digests: Iterable[str]) -> Iterator[None]:
    """Within the context, as in a worker, only content with one of these SHA-256 is executed, and nobody is asked."""
    with _deciding(_Consent(inherited=True, approved=set(digests))):
        yield


@contextmanager
def with_plugin_files(paths: Iterable[Path]) -> Iterator[None]:
    """Within the context, and in processes that are started in it, these plugin files are as if they were installed.

    Whoever names them has approved of them. Raises PluginError for what is not a Python file.
    """
    before = os.environ.get(NAMED)
    files = [PluginFile.read(path) for path in dict.fromkeys(path.absolute() for path in paths)]
    for file in files:
        _consent.get().approved.add(file.digest)
        if file.digest not in trusted_plugins():
            with suppress(OutputError):
                _record(file)
    if files:
        os.environ[NAMED] = os.pathsep.join([*filter(None, [before]), *(str(file.path) for file in files)])
    try:
        yield
    finally:
        os.environ.pop(NAMED, None)
        os.environ.update({NAMED: before} if before is not None else {})


def plugin_files_at_hand() -> tuple[PluginFile, ...]:
    """Return the plugin files of `with_plugin_files`; raises ConsentError where a worker has one with other content."""
    files = tuple(PluginFile.read(path) for path in _paths_at_hand())
    consent = _consent.get()
    for file in files:
        if consent.inherited and file.digest not in consent.approved:
            raise _content_error(file)
        consent.approved.add(file.digest)
    return files


def _paths_at_hand() -> list[Path]:
    """Return the plugin files that the environment names."""
    return [Path(text) for text in os.environ.get(NAMED, "").split(os.pathsep) if text]


def _content_error(file: PluginFile) -> ConsentError:
    """Return the error for a file whose content the command at work has not approved."""
    return ConsentError(
        f"plugin file {file.path} (SHA-256 {file.digest[:12]}...) is not executed: its content is not what the command "
        "that started this process has approved; do not change it while the command is at work, or read it, then "
        f"approve it: palpate trust {shlex.quote(printable(str(file.path)))}"
    )


@contextmanager
def _deciding(consent: _Consent) -> Iterator[None]:
    token = _consent.set(consent)
    try:
        yield
    finally:
        _consent.reset(token)


def approved_plugins() -> frozenset[str]:
    """Return the SHA-256 of the plugin files approved so far in this command or process, which workers inherit."""
    return frozenset(_consent.get().approved)


def is_named(path: Path) -> bool:
    """Return True if a person has named a file: on the command line, or, where no command is at work, in Python."""
    consent = _consent.get()
    return consent.arguments is None or ((place := _place(path)) is not None and place in consent.places)


def is_argument(assignment: str) -> bool:
    """Return True if a person has written a ``table.key=value``, as `is_named` for files; own.toml does not count."""
    arguments = _consent.get().arguments
    return arguments is None or assignment in arguments


def _places(path: Path) -> tuple[Path | None, Path | None]:
    """Return the place of an argument's file: its name in its folder, and that of the file itself if it is a link."""
    return _place(path), _resolved(path)


def _place(path: Path) -> Path | None:
    """Return the path with its folder resolved: a stranger's link to a named file is not that file."""
    folder = _resolved(path.parent)
    return folder / path.name if folder else None


def approved_files(files: Iterable[Path], place: Path, named: bool) -> tuple[PluginFile, ...]:
    """Return the plugin files of the pipeline at `place`, each read once, with content that may be executed.

    Recorded content is approved, and that of a pipeline that a person has `named`; at a terminal they are asked about
    files outside of its folder or of another user. Where it is a recording that names a file they are asked, too. What
    is approved is recorded. Raises ConsentError for content that may not be executed.
    """
    distinct = {_resolved(path) or path: path for path in files}
    return tuple(_approve(path, place, named) for path in distinct.values())


def _approve(path: Path, place: Path, named: bool) -> PluginFile:
    """Return a plugin file whose content may be executed; raises ConsentError for any other.

    `place` is the file that names it: a pipeline that a person has `named`, else a recording.
    """
    if PluginSwitch.of_environment().is_off and path.absolute() not in _paths_at_hand():
        raise ConsentError(f"plugin file {path} is not executed: --no-plugins or {SWITCH}=off forbids it")
    file, consent = PluginFile.read(path), _consent.get()
    if file.digest in consent.approved:
        return file
    if consent.inherited:
        raise _content_error(file)
    if file.digest not in trusted_plugins():
        _demand_consent(file, place, named, consent)
        with suppress(OutputError):  # then it is asked about again
            _record(file)
    consent.approved.add(file.digest)
    return file


def _demand_consent(file: PluginFile, place: Path, named: bool, consent: _Consent) -> None:
    """Raise ConsentError where nobody approves of a file whose content is not recorded.

    A message has the first 12 of the 64 digits of its SHA-256, a choice: enough for a person to compare.
    """
    reason = _strangeness(file.path, place.parent) if named else f"is named by the recording {place}"
    if file.digest in consent.refused:
        raise ConsentError(f"plugin file {file.path} is not executed: it was refused")
    if not reason or (named and not _can_ask(consent)):
        return
    if not _can_ask(consent):
        remedy = f"palpate trust {shlex.quote(printable(str(file.path)))}"
        remedy += " (in Python: palpate_engine.trust_plugin)" if consent.arguments is None else ""
        raise ConsentError(
            f"plugin file {file.path} (SHA-256 {file.digest[:12]}...) {reason}, and its content has never been "
            f"approved here, so it is not executed; read it, then approve it: {remedy}"
        )
    question = f"plugin file {file.path} (SHA-256 {file.digest[:12]}...) {reason}; a plugin can do all that you can."
    print(f"{printable(question)} Execute it? [y/N] ", file=sys.stderr)
    if sys.stdin.readline().strip().lower() not in ("y", "yes"):
        consent.refused.add(file.digest)
        raise ConsentError(f"plugin file {file.path} is not executed: it was refused")


def _strangeness(path: Path, folder: Path) -> str:
    """Return the reason to ask a person about a file that their own pipeline names; empty without one."""
    if not path.resolve().is_relative_to(folder.resolve()):
        return "lies outside of the pipeline's folder"
    return "belongs to another user" if path.stat().st_uid != os.getuid() else ""


def _can_ask(consent: _Consent) -> bool:
    return consent.arguments is not None and sys.stdin is not None and sys.stdin.isatty() and sys.stderr.isatty()


def announce(files: Iterable[PluginFile]) -> None:
    """Name, once in a command, the plugin files that are about to be executed."""
    consent = _consent.get()
    for file in files:
        key = (file.path.resolve(), file.digest)
        if consent.arguments is not None and key not in consent.announced:
            consent.announced.add(key)
            print(f"executing plugin file {printable(str(file.path))}", file=sys.stderr)


def trust_plugin(path: Path) -> PluginFile:
    """Record the content of a plugin file as approved; raises PluginError for anything else, OutputError."""
    file = PluginFile.read(path)
    if file.digest not in trusted_plugins():
        _record(file)
    return file


def trusted_plugins() -> dict[str, str]:
    """Return the path of every plugin file whose content is approved, by SHA-256.

    A record that another user owns or can change counts for nothing.
    """
    try:
        with _record_file().open("rb") as record:
            if not _is_private(os.fstat(record.fileno())):
                return {}
            lines = record.read().decode("utf-8", "replace").splitlines()
    except OSError:
        return {}
    return {match[1]: match[2] or "" for line in lines if (match := _LINE.fullmatch(line))}


def _record(file: PluginFile) -> None:
    """Append a line to the record, which commands that run at the same time share; raises OutputError."""
    place = _record_file()
    try:
        place.parent.mkdir(mode=_OWNER_FOLDER, parents=True, exist_ok=True)
        if place.exists() and not _is_private(place.stat()):
            place.unlink()
        handle = os.open(place, os.O_WRONLY | os.O_APPEND | os.O_CREAT, _OWNER_FILE)
        try:
            os.write(handle, f"{file.digest}  {printable(str(file.path.absolute()))}\n".encode())
        finally:
            os.close(handle)
    except OSError as error:
        raise OutputError(f"{place}: cannot write: {error.strerror}") from error


def _is_private(status: os.stat_result) -> bool:
    """Return True if the record belongs to this user, and no other one can change it."""
    return status.st_uid == os.getuid() and not status.st_mode & _WRITABLE_BY_OTHERS


def _record_file() -> Path:
    """Return the record's file, by the XDG base directory specification."""
    state = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(state) / "palpate" / "trusted-plugins"


def _resolved(path: Path) -> Path | None:
    """Return the path without links; None where the file system refuses it, as a text that is not a path."""
    try:
        return path.resolve()
    except (OSError, ValueError, RuntimeError):
        return None
