"""The commands of every day: run, replay, resume, check, and what looks up parts."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate import Command, Recorder, plugin

if TYPE_CHECKING:
    from palpate import Settings


@plugin
def palpate_commands() -> dict[str, Command]:
    """What is done with one pipeline, and what there is to build it of."""
    return {
        "run": Command("palpate_basics.run:run", "Run a pipeline; print what was found.", "run"),
        "rehearse": Command(
            "palpate_basics.rehearse:rehearse", "Run the pipeline of a robot in simulated time.", "run"
        ),
        "replay": Command("palpate_basics.replay:replay", "Estimate again from the log of a run.", "run"),
        "resume": Command("palpate_basics.resume:resume", "Continue a run that was interrupted.", "run"),
        "check": Command(
            "palpate_basics.inspect:check", "Show every mistake in a pipeline, without running it.", "run"
        ),
        "list": Command("palpate_basics.inspect:list_parts", "List every part, with its plugin.", "extend"),
        "describe": Command(
            "palpate_basics.inspect:describe", "Describe a part: formula, source, every key.", "extend"
        ),
        "trust": Command(
            "palpate_basics.trust:trust", "Approve a plugin file of a recording, or list what is approved.", "extend"
        ),
        "schema": Command(
            "palpate_basics.inspect:schema", "Print the JSON schema of pipeline files, or of result.json.", "extend"
        ),
    }


@plugin
def palpate_recorders() -> dict[str, Recorder]:
    """The tables of estimates of every run, as ``[estimates]`` says."""
    return {"estimates": Recorder("palpate_basics.estimates_file:estimates_file")}


@plugin
def palpate_tables() -> dict[str, type[Settings]]:
    """How the tables of estimates are written."""
    from palpate_basics.estimates_settings import EstimatesSettings

    return {"estimates": EstimatesSettings}
