"""``[sink.live]`` shows a run live on a page in the browser, ``[sink.foxglove]`` in Foxglove."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, suppress

from palpate import FlagMeaning, Run, Sink, Writer
from palpate_engine import registry
from pydantic import Field

from palpate_live.live_feed import PageFeed
from palpate_live.server_process import PageServer, ServerKind


class LiveSink(Sink):
    """Shows the run on a page in the browser, and ends it at a click: the arm retracts. It is not an emergency stop.

    The page is served on 127.0.0.1 by a process of its own, to anyone who has the address that the run prints: it
    contains a token. Nothing that process does, nor its end, ever delays the run: messages that it does not take at
    once are dropped and counted.
    """

    port: int = Field(default=0, ge=0, le=65535, description="of 127.0.0.1 that the page is served on; 0: any free one")

    def open(self, run: Run) -> AbstractContextManager[Writer]:
        """Start the page, and print its address on standard error; raises OutputError where the port is taken."""
        return _serve_run(PageServer(self.port, run.stop), run)


class FoxgloveSink(Sink):
    """Shows the run in Foxglove, which connects to the address that is printed: it may look on, and do nothing else.

    Topics and names are those of a log of palpate's, so that one layout shows both. Served on 127.0.0.1 by a process of
    its own, to anyone who has the address: it contains a token. That process never delays the run.
    """

    port: int = Field(default=0, ge=0, le=65535, description="of 127.0.0.1 that is served; 0: any free one")

    def open(self, run: Run) -> AbstractContextManager[Writer]:
        """Start serving, and print the address on standard error; raises OutputError where the port is taken."""
        return _serve_run(PageServer(self.port, None, served=_FOXGLOVE), run)


_FOXGLOVE = ServerKind("Foxglove server", "palpate_live.foxglove", "ws")


@contextmanager
def _serve_run(server: PageServer, run: Run) -> Iterator[Writer]:
    """Print the server's address, and send it the run while the context lives; print a notice of losses."""
    try:
        say(f"{server.served.name}: {server.address}")
        feed = PageFeed(run, server.send, flag_meanings())
        yield feed
        feed.flush()
    finally:
        if (notice := server.close()) is not None:
            say(f"palpate: {notice}")


def say(text: str) -> None:
    """Print a line on standard error, if a terminal is there."""
    with suppress(OSError):  # a terminal that has gone
        print(text, file=sys.stderr, flush=True)


def flag_meanings() -> dict[str, FlagMeaning]:
    """Return the meanings of the flags of all installed packages, by their codes."""
    return registry.offers("palpate_flags", FlagMeaning)
