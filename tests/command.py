"""The command line as a function: the same `main`, without the second of imports that a process costs."""

import contextlib
import io
import logging
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

from palpate_engine.cli import main

_AT_A_TERMINAL = {
    signal.SIGINT: signal.default_int_handler,
    signal.SIGHUP: signal.SIG_DFL,
    signal.SIGTERM: signal.SIG_DFL,
}


def call(*arguments, cwd, PYTHONPATH="", **environment):
    """What `subprocess.run` would give: exit code, output and errors of a command in a folder, 140 columns wide.

    What a process would take with it at its end is put back: folder, environment, signals, loggers, modules of plugins;
    `main` itself does so with warnings.
    """
    words = ["palpate", *map(str, arguments)]
    out, errors, code = io.StringIO(), io.StringIO(), 0
    with contextlib.ExitStack() as stack, Path(os.devnull).open() as nothing:
        for context in (
            _environment(),
            signals_of_a_terminal(),
            _loggers(),
            _modules(str(PYTHONPATH).split(os.pathsep)),
        ):
            stack.enter_context(context)
        stack.enter_context(contextlib.chdir(cwd))
        os.environ.update({"COLUMNS": "140", **environment})
        sys.argv, sys.stdin = words, nothing
        stack.enter_context(contextlib.redirect_stdout(out))
        stack.enter_context(contextlib.redirect_stderr(errors))
        try:
            main()
        except SystemExit as end:
            code = end.code or 0
    return subprocess.CompletedProcess(words, code, out.getvalue(), errors.getvalue())


@contextlib.contextmanager
def _environment():
    variables, words, stdin = dict(os.environ), sys.argv, sys.stdin
    try:
        yield
    finally:
        sys.argv, sys.stdin = words, stdin
        for name in os.environ.keys() - variables.keys():
            del os.environ[name]
        os.environ.update(variables)


@contextlib.contextmanager
def signals_of_a_terminal():
    """Those of a terminal: under nohup, and in the background of a shell, pytest itself has others."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, handler) for number, handler in _AT_A_TERMINAL.items()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def _loggers():
    root = logging.getLogger()
    handlers, level, disabled = root.handlers[:], root.level, root.manager.disable
    try:
        yield
    finally:
        root.handlers[:] = handlers
        root.setLevel(level)
        root.manager.disable = disabled


@contextlib.contextmanager
def _modules(folders):
    """Modules are looked for in these folders, too; theirs and those of plugin files are imported anew."""
    before, path = set(sys.modules), sys.path[:]
    folders = [str(folder) for folder in folders if folder]
    sys.path[1:1] = folders
    try:
        yield
    finally:
        sys.path[:] = path
        for name in sys.modules.keys() - before:
            file = getattr(sys.modules[name], "__file__", None) or ""
            if name.startswith("palpate_file_") or any(Path(file).is_relative_to(folder) for folder in folders):
                del sys.modules[name]
