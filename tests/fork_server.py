"""Run as ``python -c``: a process that has imported what commands need, and forks one for each program asked for.

A fork gets its own folder, environment, arguments, streams and, where wanted, session; signals are as Python sets them
at its start. It runs its program as `__main__`, ends as an interpreter ends, and its status is told by a pipe.
"""

import contextlib
import gc
import importlib
import io
import json
import os
import select
import signal
import socket
import sys
import types
import warnings

IMPORTED = (
    "numpy", "numpy.random", "pydantic", "typer", "rich.console", "rich.table", "rich.progress", "casadi",
    "llvmlite.binding", "scipy.ndimage", "mcap.writer", "mcap.reader", "serial", "rtde_control", "rtde_receive",
    "palpate.cli", "palpate.pipeline", "palpate.host", "palpate_models", "palpate_trajectories",
    "palpate_filters.kernel.columns", "palpate_devices.mcap_replay", "palpate_devices.bota.device",
    "palpate_devices.ur3e.device", "palpate_devices.ur3e.twin", "palpate_basics.commands", "pytest", "palpate_testing",
)  # fmt: skip
MOST = 1 << 17  # [bytes] of a request


def serve(control):
    """Fork for every request until whoever asks has gone; return the request and its descriptors in the fork."""
    awake, wakes = os.pipe()
    os.set_blocking(awake, False)
    os.set_blocking(wakes, False)
    signal.set_wakeup_fd(wakes)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends who asks, and that ends this
    reports = {}
    control.send(b"ready")
    while True:
        ready, _, _ = select.select([control, awake], [], [])
        if awake in ready:
            os.read(awake, 4096)
            reap(reports)
        if control in ready:
            words, streams, _, _ = socket.recv_fds(control, MOST, 4)
            if not words:
                os._exit(0)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", DeprecationWarning)  # of forking beside the threads of BLAS
                child = os.fork()
            if not child:
                control.close()
                signal.set_wakeup_fd(-1)
                return json.loads(words), streams
            reports[child] = streams.pop()
            for stream in streams:
                os.close(stream)
            control.send(b"%d" % child)


def reap(reports):
    """Tell how each fork has ended that has."""
    while reports:
        child, status = os.waitpid(-1, os.WNOHANG)
        if not child:
            return
        report = reports.pop(child)
        with contextlib.suppress(BrokenPipeError):  # nobody wants to know
            os.write(report, b"%d" % os.waitstatus_to_exitcode(status))
        os.close(report)


def become(request, streams):
    """Make this fork what a process of its own would be."""
    for number, stream in enumerate(streams[:3]):
        os.dup2(stream, number)
    os.closerange(3, 1 << 12)
    sys.stdin = sys.__stdin__ = text_of(0, sys.stdin)
    sys.stdout = sys.__stdout__ = text_of(1, sys.stdout)
    sys.stderr = sys.__stderr__ = text_of(2, sys.stderr)
    for number in (signal.SIGCHLD, signal.SIGHUP, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if request["session"]:
        os.setsid()
    os.chdir(request["cwd"])
    before = folders()
    os.environ.clear()
    os.environ.update(request["env"])
    if folders() != before:
        sys.path[1:] = [*folders(), *(place for place in sys.path[1:] if place not in before)]
    sys.argv = ["-c", *request["arguments"]]


def text_of(number, before):
    """A stream of what is now there, as Python makes it at its start."""
    whole = not isinstance(before.buffer, io.RawIOBase)  # it is where PYTHONUNBUFFERED is set
    buffer = open(number, "wb" if number else "rb", -1 if whole else 0, closefd=False)  # noqa: SIM115
    (buffer.raw if whole else buffer).name = before.name
    lines = before.line_buffering or (whole and os.isatty(number))
    end = "\n" if number else None
    return io.TextIOWrapper(buffer, before.encoding, before.errors, end, lines, before.write_through)


def folders():
    """Where PYTHONPATH says that modules are."""
    return [os.path.abspath(place) for place in os.environ.get("PYTHONPATH", "").split(os.pathsep) if place]


def imported():
    """Import what is there."""
    for name in IMPORTED:
        with contextlib.suppress(ModuleNotFoundError):  # an extra that is not installed
            importlib.import_module(name)


if __name__ == "__main__":
    imported()
    gc.collect()
    gc.freeze()  # what all forks share is not gone through, and not copied, by each of them
    request, streams = serve(socket.socket(fileno=int(sys.argv[1])))
    become(request, streams)
    sys.modules["__main__"] = program = types.ModuleType("__main__")
    exec(compile(request["code"], "<string>", "exec"), program.__dict__)
