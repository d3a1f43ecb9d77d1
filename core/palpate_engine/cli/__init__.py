"""The command line, and what an exit code says. Nothing else is imported before Ctrl-C is looked after."""

from __future__ import annotations

import signal
import sys
from collections.abc import Sequence

from palpate_engine.cli.import_interrupts import deferred_interrupts


def main(arguments: Sequence[str] | None = None, approved: Sequence[str] | None = None) -> None:
    """Run the ``palpate`` command; where a program calls it on its own, with the SHA-256 that it has `approved`.

    Exit code 0, 2 for what the user can mend, 1 for what they cannot, 3 where an arm was stopped and no states show
    that it stands, 128 and the signal's number for what stopped it: 130 for Ctrl-C, 143 for SIGTERM, 129 for a terminal
    that has gone.
    """
    try:
        with deferred_interrupts():
            from palpate_engine.cli.command_line import run_command_line

            run_command_line(sys.argv[1:] if arguments is None else arguments, approved)
    except KeyboardInterrupt:  # while something is set up, or taken down
        print("palpate: stopped", file=sys.stderr)
        sys.exit(128 + signal.SIGINT)


def call(arguments: Sequence[str], ends: bool = False) -> None:
    """Do what a command line asks for within this process; with `ends` the process ends with the exit code.

    Raises PalpateError, and without `ends` also what the reader of the command's own arguments raises.
    """
    from palpate_engine.cli.command_line import call as call_command

    call_command(arguments, ends)
