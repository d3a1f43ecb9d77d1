"""Watch a run live: a page in the browser, a panel on the terminal, and the same page of a recorded run."""

from __future__ import annotations

from palpate import Command, Display, plugin


@plugin
def palpate_sinks() -> dict[str, str]:
    """Return the page and the Foxglove server."""
    return {"live": "palpate_live.sink:LiveSink", "foxglove": "palpate_live.sink:FoxgloveSink"}


@plugin
def palpate_commands() -> dict[str, Command]:
    """Return the page of a recorded run."""
    return {"replay watch": Command("palpate_live.watch_command:watch", "See a recorded run on the live page.", "run")}


@plugin
def palpate_offers() -> dict[str, dict[str, Display]]:
    """Return the panel."""
    return {"display": {"panel": Display("palpate_live.terminal_panel:panel")}}
