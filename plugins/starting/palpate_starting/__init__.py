"""The beginning: pipelines and distributions to start from, and completion for the shell."""

from palpate import Command, Template, plugin


@plugin
def palpate_commands() -> dict[str, Command]:
    """What one starts with."""
    return {
        "init": Command("palpate_starting.init:init", "Write a pipeline or a plugin to start from.", "run"),
        "completion": Command(
            "palpate_starting.completion:completion", "Print the completion of palpate for a shell.", "extend"
        ),
    }


@plugin
def palpate_templates() -> dict[str, Template]:
    """Whole pipelines, each of which runs as it is."""
    package, folder = "palpate_starting", "templates"
    return {
        "point": Template(package, f"{folder}/point.toml", "a point palpation on a simulated rig"),
        "log": Template(package, f"{folder}/log.toml", "your own log; comes with an example"),
        "ur3e": Template(package, f"{folder}/point_ur3e.toml", "a UR3e and a SensONE, or their twins"),
        "raster": Template(package, f"{folder}/raster.toml", "a map of 60 mm x 40 mm, simulated"),
        "calibrate": Template(package, f"{folder}/guided.toml", "a calibration step by step, simulated"),
    }
