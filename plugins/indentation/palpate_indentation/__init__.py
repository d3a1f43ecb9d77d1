"""Whole curves: one press over all its depth, from the contact point to the pull-off."""

from __future__ import annotations

from palpate import Command, FlagMeaning, plugin


@plugin
def palpate_commands() -> dict[str, Command]:
    """Analyses of a press."""
    return {
        "fit indentation": Command(
            "palpate_indentation.indentation_command:indentation",
            "A press as a whole: E over depth, contact point, adhesion, large strain.",
        ),
    }


@plugin
def palpate_flags() -> dict[str, FlagMeaning]:
    """Return the meanings of the flags of a press."""
    return {
        "modulus-over-depth": FlagMeaning(
            "doubtful",
            "The modulus of the deeper half of a press differs from that of the shallower one beyond its uncertainty.",
            "Declare the layer's thickness, a large-strain tip or adhesion; else give the modulus with its depth.",
        ),
        "adhesion": FlagMeaning(
            "note",
            "The material pulls the tip before it comes off, which the model leaves out.",
            "Use the model jkr (soft, large tips) or dmt (stiff, small ones), or wet the surface.",
        ),
        "baseline-unclear": FlagMeaning(
            "doubtful",
            "The air does not show the tilt of the baseline, which is held at zero, or the tilt is most of the force.",
            "Record air over a fourth of the depth at least, or take --no-tilt where the force in air is level.",
        ),
        "viscosity-unclear": FlagMeaning(
            "doubtful",
            "What a press leaves open of its viscosity moves the modulus by more than 5 %, and more than all else.",
            "State it by --parameter, press slower or at two speeds, or record the way out, too.",
        ),
    }
