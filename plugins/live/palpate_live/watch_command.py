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

from palpate_live.estimates_replay import read_tables, tell
from palpate_live.live_feed import PageFeed
from palpate_live.recorded_skin import skin_and_extent
from palpate_live.server_process import PageServer
from palpate_live.sink import meanings, say

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
    if (known := read_tables(source)) is not None:
        if overrides:
            raise ConfigurationError(f"{source}: has no log to estimate again from; watch it without --set")
        say("the run has no log: its table of estimates is shown, with flags and devices as they were at the end")
        _serve(port, lambda child: tell(known, PageFeed(known.run, child.send, meanings(), recorded=True)))
        return
    carried = read_run_log(source)
    if carried is None:
        raise ConfigurationError(
            f"{source}: carries no pipeline, so not a log of palpate's: `palpate info {source} --suggest` writes one"
        )
    text = replay_source(carried)
    for assignment in overrides or ():
        text.override(assignment)
    pipeline = build_pipeline(text)
    _serve(port, lambda child: _filled(child, pipeline, source))


def _serve(port: int, fill: Callable[[PageServer], bool]) -> None:
    """Have a page filled, and keep it until Ctrl-C."""
    child = PageServer(port, None, patient=True)
    try:
        say(f"live page: {child.address}")
        if fill(child):
            say("all of the record is there; Ctrl-C ends")
            child.wait()
    except KeyboardInterrupt:
        pass
    finally:
        notice = child.close()
    if notice is not None:
        say(f"palpate: {notice}")


def _filled(child: PageServer, pipeline: Pipeline, source: Path) -> bool:
    """Estimate the record again, and send all of it to the page; returns whether it reached its end."""
    tracks = {str(track.name): track.model.parameters for track in pipeline.tracks}
    surface, extent = skin_and_extent(source)
    run = Run(*(source, pipeline.ports.streams, tracks, {}, {}, pipeline.run.name), extent=extent, surface=surface)
    feed = PageFeed(run, child.send, meanings(), recorded=True)
    with tempfile.TemporaryDirectory(prefix="palpate-watch-") as folder:
        result = run_pipeline(pipeline, Path(folder) / "run", observer=feed)
    if result.interrupted is not None:
        return False
    if source.is_dir() and (known := RunFolder(source)).finished:
        try:
            feed.result(known.result)  # it knows why it ended
        except LogError as error:
            say(f"palpate: {error}")
    return True
