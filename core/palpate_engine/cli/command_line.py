"""The command line: the commands of the core and of all plugins, and how a command ends."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import sys
import traceback
import warnings
from collections.abc import Sequence
from types import FrameType, SimpleNamespace
from typing import Any

from palpate.discovery import discover, plugin_file_of
from palpate.errors import PalpateError, PluginError, error_in
from palpate.offers import function_of
from palpate.plugin_origin import Plugin
from palpate.plugin_switch import OFF, only_plugins
from palpate.printable_text import printable
from palpate.safe_path import safe_processes, without_current_folder
from palpate.trust import at_the_command_line, inherited_approval, plugin_files_at_hand, with_plugin_files

from palpate_engine.cli.commands import (
    CommandCall,
    Invocation,
    call_of,
    demand_no_former_option,
    epilog,
    group_text,
    help_text,
    is_hidden,
    parse_arguments,
    start_text,
    version_text,
)
from palpate_engine.terminal_escape import harmless_output

# One thread of linear algebra, set before numpy is imported: on small matrices more threads only wait for one another,
# work is spread over processes, and sums have the same bits on any number of cores.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
ARGUMENT_READERS = ("click.", "typer.")  # modules of the libraries that read a command's own arguments
# Where Ctrl-C comes while pydantic makes a class, of a part that is imported, it makes an error of its own of it.
_CTRL_C = re.compile(r"SchemaError: .*\bKeyboardInterrupt: ", re.DOTALL)


def run_command_line(arguments: Sequence[str], approved: Sequence[str] | None = None) -> None:
    """Do what a command line asks for, and end the process with its exit code; see `palpate_engine.cli.main`."""
    consent = at_the_command_line(arguments) if approved is None else inherited_approval(approved)
    with harmless_output(), safe_processes(), without_current_folder(), consent:
        _main(arguments)


def _main(arguments: Sequence[str]) -> None:
    """Run the command of some arguments; whatever it raises becomes a message and an exit code."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # numpy's: numbers out of range become flags, in words
            try:
                call(arguments, ends=True)
            except SystemExit as end:
                sys.stdout.flush()  # a full disk is reported here, not by the interpreter
                if _culprit(end) is not None:  # a part that calls exit()
                    sys.exit(_report(end))
                raise
            sys.stdout.flush()
    except BrokenPipeError:  # the reader of a pipe, such as head, has gone
        sys.stderr.close()
        sys.exit(1)
    except (KeyboardInterrupt, Exception) as error:
        sys.exit(_report(error))


def _report(error: BaseException) -> int:
    """Print an error that is being handled; return its exit code."""
    if isinstance(error, KeyboardInterrupt) or _CTRL_C.search(f"{type(error).__name__}: {error}"):
        print("palpate: stopped", file=sys.stderr)
        return 128 + signal.SIGINT
    if (plugin := _culprit(error)) is not None:
        error = PluginError(f"plugin {plugin} failed: {error_in(error)}")
    if isinstance(error, PalpateError):
        with contextlib.suppress(OSError):  # a terminal that has gone
            print(f"palpate: {printable(str(error), lines=True)}", file=sys.stderr)
        return error.exit_code
    traceback.print_exc()
    print("palpate: this is a bug in palpate or in a plugin of yours, not in your pipeline", file=sys.stderr)
    return 1


def _culprit(error: BaseException) -> str | None:
    """Return the third party's plugin whose code raised an error, or called what did; None of one of palpate's own."""
    if isinstance(error, PalpateError):
        return None
    # From the innermost frame outwards: the first that is of a third party's file or package.
    frames = [frame for frame, _ in traceback.walk_tb(error.__traceback__)]
    if isinstance(error, SystemExit):
        # The reader of a command's arguments ends the process itself; of exit() below it the command is first.
        readers = [k for k, frame in enumerate(frames) if frame.f_globals["__name__"].startswith(ARGUMENT_READERS)]
        frames = frames[readers[-1] + 1 :] if readers else []
    if not frames:
        return None
    strangers = [plugin for plugin in discover(plugin_files_at_hand()).plugins.values() if not plugin.own]
    # A command of a third party may end the process, which a part may not.
    if isinstance(error, SystemExit) and _holder(frames[0], strangers) is not None:
        return None
    return next((name for frame in reversed(frames) if (name := _holder(frame, strangers)) is not None), None)


def _holder(frame: FrameType, plugins: Sequence[Plugin]) -> str | None:
    """Return the name of the plugin, or the path of the plugin file, that holds the code of a frame."""
    file = plugin_file_of(SimpleNamespace(**frame.f_globals))
    names = [plugin.name for plugin in plugins if plugin.holds(frame.f_code.co_filename)]
    return names[0] if names else str(file.path) if file is not None else None


def call(arguments: Sequence[str], ends: bool = False) -> None:
    """Do what a command line asks for within this process; with `ends` the process ends with the exit code.

    Raises PalpateError, and without `ends` also what the reader of the command's own arguments raises.
    """
    invocation = parse_arguments(arguments)
    with only_plugins(OFF if invocation.forbids else None), with_plugin_files(invocation.files):
        _do(invocation, ends)


def _do(invocation: Invocation, ends: bool) -> None:
    """Print version, start or help, or call the command that an invocation names."""
    if invocation.wants == "version":
        print(version_text())
    elif invocation.wants == "start":
        print(start_text())
    elif invocation.wants == "help":
        print(help_text())
    else:
        _call(call_of(invocation), ends)


def _call(meant: CommandCall, ends: bool) -> None:
    """Call the function of the command that is meant with its own arguments, read by the function's annotations.

    With `ends` the process ends with the command, as at a shell.
    """
    import typer

    if meant.command is None:
        print(group_text(meant))
        return
    demand_no_former_option(meant)
    single = typer.Typer(
        add_completion=False,
        pretty_exceptions_enable=False,
        rich_markup_mode="markdown",  # rich's own markup would take [tables] for tags
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    single.command(name=meant.name, epilog=epilog(meant))(function_of(meant.command))
    command: Any = typer.main.get_command(single)
    context = command.context_class(command, **command.context_settings)
    for parameter in command.get_params(context):  # with --help, of which the command keeps one object
        parameter.hidden |= is_hidden(meant, parameter.opts)
        if getattr(parameter, "is_flag", False):
            parameter.metavar = ""  # it takes no value, and the help shows no type
    command(args=list(meant.arguments), prog_name=f"palpate {meant.name}", standalone_mode=ends)
