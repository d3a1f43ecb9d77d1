"""Hardware: a rig looked at before it moves, and its twin."""

from palpate import Command, plugin


@plugin
def palpate_commands() -> dict[str, Command]:
    """What is done with a rig."""
    return {
        "doctor": Command("palpate_hardware.doctor:doctor", "Look at robot and sensor; nothing moves.", "hardware"),
        "twin": Command("palpate_hardware.twin:twin", "Serve the rig of a pipeline in software.", "hardware"),
    }
