"""The commands for one pipeline, for a rig, and for looking parts up."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate import Command, Recorder, Template, plugin

if TYPE_CHECKING:
    from palpate import Settings


@plugin
def palpate_commands() -> dict[str, Command]:
    """Return the commands for one pipeline or rig, and those that look parts up."""
    commands = (
        ("run", "run:run", "Run a pipeline; print what was found.", "run"),
        ("replay", "replay:replay", "Estimate again from the log of a run.", "run"),
        ("run resume", "resume:resume", "Continue a run that was interrupted.", "run"),
        ("check", "check:check", "Show every mistake in a pipeline, without running it.", "begin"),
        ("init", "init:init", "Write a pipeline or a plugin to start from.", "begin"),
        ("doctor", "doctor:doctor", "Check robot and sensor; nothing moves.", "hardware"),
        (
            "acceptance",
            "acceptance.acceptance_command:acceptance",
            "Stop a rig in every way, measure it, write a page to sign.",
            "hardware",
        ),
        ("twin", "twin:twin", "Serve robot and sensor of a pipeline in software.", "hardware"),
        ("list", "list_parts:list_parts", "List every part, with its plugin.", "extend"),
        ("describe", "describe:describe", "Describe a part: formula, source, every key.", "extend"),
    )
    schema = "Print the JSON schema of pipeline files, or of result.json."
    return {
        **{name: Command(f"palpate_commands.{target}", text, panel) for name, target, text, panel in commands},
        "trust": Command(
            "palpate_commands.trust:trust", "Approve a plugin file of a recording.", "extend", hidden=True
        ),
        "describe schema": Command("palpate_commands.schema:schema", schema, "extend"),
        "init completion": Command(
            "palpate_commands.completion:completion",
            "Print the completion of palpate for a shell.",
            "begin",
        ),
    }


@plugin
def palpate_offers() -> dict[str, dict[str, Recorder]]:
    """Return the recorder of every run's estimates, as ``[estimates]`` says."""
    return {"recorder": {"estimates": Recorder("palpate_kit.runs.estimates_file:estimates_file")}}


@plugin
def palpate_tables() -> dict[str, type[Settings]]:
    """Return the settings of the tables of estimates."""
    from palpate_kit.runs.estimates_settings import EstimatesSettings

    return {"estimates": EstimatesSettings}


@plugin
def palpate_templates() -> dict[str, Template]:
    """Return whole pipelines, each of which runs as it is."""
    package, folder = "palpate_commands", "templates"
    return {
        "point": Template(package, f"{folder}/point.toml", "a point palpation on a simulated rig"),
        "chirp": Template(package, f"{folder}/chirp.toml", "several frequencies in one motion, simulated"),
        "log": Template(package, f"{folder}/log.toml", "your own log; comes with an example"),
        "ur3e": Template(package, f"{folder}/point_ur3e.toml", "a UR3e and a SensONE, or their twins"),
        "raster": Template(package, f"{folder}/raster.toml", "a map of 60 mm x 40 mm, simulated"),
        "raster-ur3e": Template(
            package, f"{folder}/raster_ur3e.toml", "a map with a UR3e and a SensONE, or their twins"
        ),
        "breast-ur3e": Template(
            package, f"{folder}/breast_ur3e.toml", "a curved phantom: touched, registered, mapped; with its mesh"
        ),
        "calibrate": Template(package, f"{folder}/guided.toml", "a calibration step by step, simulated"),
    }
