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
        return _opened(PageServer(self.port, run.stop), run)


class FoxgloveSink(Sink):
    """Shows the run in Foxglove, which connects to the address that is printed: it may look on, and do nothing else.

    Topics and names are those of a log of palpate's, so that one layout shows both. Served on 127.0.0.1 by a process of
    its own, to anyone who has the address: it contains a token. That process never delays the run.
    """

    port: int = Field(default=0, ge=0, le=65535, description="of 127.0.0.1 that is served; 0: any free one")

    def open(self, run: Run) -> AbstractContextManager[Writer]:
        """Start serving, and print the address on standard error; raises OutputError where the port is taken."""
        return _opened(PageServer(self.port, None, served=_FOXGLOVE), run)


_FOXGLOVE = ServerKind("Foxglove server", "palpate_live.foxglove", "ws")


@contextmanager
def _opened(child: PageServer, run: Run) -> Iterator[Writer]:
    try:
        say(f"{child.served.name}: {child.address}")
        feed = PageFeed(run, child.send, meanings())
        yield feed
        feed.flush()
    finally:
        if (notice := child.close()) is not None:
            say(f"palpate: {notice}")


def say(text: str) -> None:
    """A line on standard error, where there is one."""
    with suppress(OSError):  # a terminal that has gone
        print(text, file=sys.stderr, flush=True)


def meanings() -> dict[str, FlagMeaning]:
    """What the flags of everything that is installed mean."""
    return registry.offers("palpate_flags", FlagMeaning)
