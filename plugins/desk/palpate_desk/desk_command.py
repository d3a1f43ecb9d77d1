"""``palpate desk``: a folder of curves in the browser."""

from __future__ import annotations

import asyncio
import contextlib
import multiprocessing
import os
import shlex
import signal
import socket
import webbrowser
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer
from palpate import ConfigurationError, OutputError
from palpate_engine import RIG, analysis, make_folder, parsed_assignment, read_rig
from palpate_kit.curves.fit_folder import is_fit_folder
from palpate_kit.page.listening_socket import listening_socket
from palpate_kit.terminal.fact_options import with_facts
from palpate_kit.terminal.json_output import print_aside
from palpate_kit.terminal.options import Overrides

from palpate_desk.action import OUT, Action
from palpate_desk.history_file import ActionHistory


@with_facts
def desk(
    source: Annotated[Path, typer.Argument(metavar="FOLDER", help="A folder of fits, or of curves to fit.")],
    tip: Annotated[str | None, typer.Option(help='Of curves: their tip, such as "sphere 3 mm" (its radius).')] = None,
    model: Annotated[str | None, typer.Option(help="With --tip: the contact model. [default: dr]")] = None,
    pipeline: Annotated[Path | None, typer.Option(help="Of curves: how to read and fit them.")] = None,
    overrides: Overrides = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Of curves: the folder of their fits. [default: runs/...]")
    ] = None,
    groups: Annotated[Path | None, typer.Option(help="A CSV with a column `curve`, and columns to group by.")] = None,
    port: Annotated[int, typer.Option(help="Port of 127.0.0.1; 0: any free one.", min=0, max=65535)] = 0,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Print the address only.")] = False,
    read_only: Annotated[bool, typer.Option("--read-only", help="Look only: nothing is written.")] = False,
    workers: Annotated[int | None, typer.Option(help="Processes that fit all. [default: all cores]", min=1)] = None,
    history: Annotated[
        bool, typer.Option("--history", help="Print what was done on the page as a shell script, and end.")
    ] = False,
) -> None:
    """Open a folder of curves as a page: look at each, mark, change settings, refit, compare groups, export.

    What is done there is kept in text files of the folder, and printed as the command that does the same. Ctrl-C ends
    it; nothing is lost.
    """
    if history:
        typer.echo(ActionHistory(_demand_fits(source)).script, nl=False)
        return
    folder = source
    if not is_fit_folder(source):
        folder = _make_fits(source, tip, model, pipeline, overrides, out, read_only)
    elif tip or model or pipeline or overrides or out:
        raise ConfigurationError(f"{source}: is a folder of fits, which has its settings: change them on the page")
    if groups is not None:
        if read_only:
            raise ConfigurationError("--groups: writes curves.csv, which --read-only does not")
        with print_aside(True):
            analysis("fit")([folder], groups=groups, no_refit=True)
    _serve_folder(folder, port, no_browser, read_only, workers)


def _demand_fits(source: Path) -> Path:
    """Return a folder of fits; raises ConfigurationError for another one."""
    if not is_fit_folder(source):
        raise ConfigurationError(f"{source}: is not a folder of fits: it has no fits.csv")
    return source


def _make_fits(
    source: Path,
    tip: str | None,
    model: str | None,
    pipeline: Path | None,
    overrides: list[str] | None,
    out: Path | None,
    read_only: bool,
) -> Path:
    """Return a new folder of fits of the curves of `source`, none of which is fitted yet; raises UserError.

    A `pipeline` is how to read and fit them; else the `tip` and a `model`, with settings in `overrides`. The command
    that makes the folder is the first of its history.
    """
    if not source.exists():
        raise ConfigurationError(f"{source}: no such file or folder")
    if read_only:
        raise ConfigurationError(f"{source}: has no fits yet, and --read-only makes none")
    if tip is None and pipeline is None and not _states_tip(source, overrides or ()):
        raise ConfigurationError(
            f'{source}: is not a folder of fits; give the tip of its curves: --tip "sphere 3 mm", or --pipeline FILE'
        )
    folder = out or make_folder("fit", None, datetime.now(UTC).astimezone())
    with print_aside(True):
        analysis("fit")(
            [source], pipeline=pipeline, tip=tip, model=model, overrides=overrides, out=folder,
            each=pipeline is not None, no_refit=True,
        )  # fmt: skip
    # The same command in the history.
    options = [("--each", "")] if pipeline else []
    for option, text in (("--tip", tip), ("--model", model), ("--pipeline", str(pipeline) if pipeline else None)):
        if text is not None:
            options.append((option, text))
    options += [("--set", assignment) for assignment in overrides or ()]
    history = ActionHistory(folder)
    if not history.commands:
        history.append(Action("fit", (*options, ("--no-refit", ""), ("--out", OUT)), str(source)))
    return folder


def _states_tip(source: Path, overrides: Sequence[str]) -> bool:
    """Return True if the file of facts that ``run.rig`` names, or else the one next to the curves, states their tip."""
    folder = source if source.is_dir() else source.parent
    named_files = [str(value) for keys, value in map(parsed_assignment, overrides) if keys == ("run", "rig")]
    file = Path(named_files[0]) if named_files else folder / RIG
    return file.is_file() and read_rig(file).tip is not None


def _serve_folder(folder: Path, port: int, no_browser: bool, read_only: bool, workers: int | None) -> None:
    """Print the address of the page of a folder, open a browser and serve the page until Ctrl-C.

    `read_only` pages take no lock and write nothing; at most so many `workers` fit.
    """
    from palpate_desk.desk import Desk, writing
    from palpate_desk.desk_server import DeskServer

    with contextlib.nullcontext() if read_only else writing(folder), _listening_socket(port) as listener:
        server = DeskServer(Desk(folder), read_only, workers)
        address = f"http://127.0.0.1:{listener.getsockname()[1]}/{server.token}/"
        typer.echo(
            f"palpate desk {shlex.quote(str(folder))}: {address}\nCtrl-C ends it; everything is kept in the folder"
        )
        if not no_browser and (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
            webbrowser.open(address)
        try:
            asyncio.run(_serve(server, listener))
        finally:
            for child in multiprocessing.active_children():  # nobody waits for their fits any more
                child.terminate()


async def _serve(server: object, listener: socket.socket) -> None:
    """Serve until Ctrl-C or SIGTERM."""
    task = asyncio.ensure_future(server.run(listener))  # type: ignore[attr-defined]
    for ending_signal in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        asyncio.get_running_loop().add_signal_handler(ending_signal, task.cancel)
    with contextlib.suppress(asyncio.CancelledError):
        await task


def _listening_socket(port: int) -> socket.socket:
    """Return a socket that listens at a port of 127.0.0.1; raises OutputError where the port is in use."""
    try:
        return listening_socket(port)
    except OSError as error:
        raise OutputError(f"--port {port}: cannot be used: {error.strerror}; 0 takes a free one") from error
