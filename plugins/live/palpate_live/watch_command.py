"""``palpate replay watch``: the live page of a recorded run."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from palpate import ConfigurationError, LogError, Run
from palpate_engine import build_pipeline, run_pipeline
from palpate_kit.runs.replay_source import read_run_log, replay_source
from palpate_kit.runs.run_folder import RunFolder
from palpate_kit.terminal.options import Overrides

from palpate_live.estimates_replay import read_tables, send_recorded_run
from palpate_live.live_feed import PageFeed
from palpate_live.recorded_skin import skin_and_extent
from palpate_live.server_process import PageServer
from palpate_live.sink import flag_meanings, say

if TYPE_CHECKING:
    from palpate_engine import Pipeline


def watch(
    source: Annotated[Path, typer.Argument(metavar="RUN_OR_LOG", help="A run folder, or a log that palpate wrote.")],
    overrides: Overrides = None,
    port: Annotated[int, typer.Option(help="Port of 127.0.0.1; 0: any free one.", min=0, max=65535)] = 0,
) -> None:
    """Show a recorded run on the live page, with a time slider, at any speed; Ctrl-C ends it.

    The run is estimated again from its log, to the same numbers; one that has no log is shown from its table of
    estimates. Nothing is written.
    """
    recorded = read_tables(source)
    if recorded is not None:
        if overrides:
            raise ConfigurationError(f"{source}: has no log to estimate again from; watch it without --set")
        say("the run has no log: its table of estimates is shown, with flags and devices as they were at the end")
        run = recorded.run
        _serve(port, lambda server: send_recorded_run(recorded, _recorded_feed(run, server)))
        return
    run_log = read_run_log(source)
    if run_log is None:
        raise ConfigurationError(
            f"{source}: carries no pipeline, so not a log of palpate's: `palpate info {source} --suggest` writes one"
        )
    pipeline_source = replay_source(run_log)
    for assignment in overrides or ():
        pipeline_source.override(assignment)
    pipeline = build_pipeline(pipeline_source)
    _serve(port, lambda server: _replay_log(server, pipeline, source))


def _serve(port: int, fill: Callable[[PageServer], bool]) -> None:
    """Serve a page that `fill` sends a record to, until Ctrl-C; `fill` returns True if it sent all of it."""
    server = PageServer(port, None, patient=True)
    try:
        say(f"live page: {server.address}")
        if fill(server):
            say("all of the record is there; Ctrl-C ends")
            server.wait()
    except KeyboardInterrupt:
        pass
    finally:
        notice = server.close()
    if notice is not None:
        say(f"palpate: {notice}")


def _recorded_feed(run: Run, server: PageServer) -> PageFeed:
    """Return the feed of a recorded run to a page."""
    return PageFeed(run, server.send, flag_meanings(), recorded=True)


def _replay_log(server: PageServer, pipeline: Pipeline, source: Path) -> bool:
    """Estimate a record again, and send all of it to the page; return True if its end was reached.

    `source` is the run folder or the log. Files of this run go to a temporary folder.
    """
    tracks = {str(track.name): track.model.parameters for track in pipeline.tracks}
    surface, extent = skin_and_extent(source)
    streams, name = pipeline.ports.streams, pipeline.run.name
    run = Run(source, streams, tracks, facts={}, documents={}, name=name, extent=extent, surface=surface)
    feed = _recorded_feed(run, server)
    with tempfile.TemporaryDirectory(prefix="palpate-watch-") as folder:
        result = run_pipeline(pipeline, Path(folder) / "run", observer=feed)
    if result.interrupted is not None:
        return False
    # The recorded result replaces that of the replay: only it has the reason why the run ended.
    if source.is_dir() and (run_folder := RunFolder(source)).finished:
        try:
            feed.result(run_folder.result)
        except LogError as error:
            say(f"palpate: {error}")
    return True
