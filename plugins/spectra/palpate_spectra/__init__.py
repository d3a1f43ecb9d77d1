"""Spectra: storage and loss modulus over frequency, from recordings of oscillations in contact."""

from __future__ import annotations

from palpate import Command, FlagMeaning, plugin


@plugin
def palpate_commands() -> dict[str, Command]:
    """One command."""
    return {
        "spectrum": Command("palpate_spectra.command:spectrum", "Storage and loss modulus over frequency."),
    }


@plugin
def palpate_flags() -> dict[str, FlagMeaning]:
    """What their flags mean."""
    return {
        "harmonics": FlagMeaning(
            "doubtful",
            "The force has multiples or sums of the motion's frequencies that the tip's own law does not make.",
            "Use a smaller amplitude, another tip or thickness, or find out what rattles or slips.",
        ),
        "kramers-kronig": FlagMeaning(
            "doubtful",
            "G' and G'' over frequency are not those of one causal, passive, linear material.",
            "Check the tip's mass, delays and series_stiffness; take recordings of one specimen at one depth only.",
        ),
        "loss-not-distinguishable": FlagMeaning(
            "doubtful",
            "The declared uncertainty of timing alone could explain the loss modulus at this frequency.",
            "Calibrate the delay, or record several frequencies and look at the fitted delay.",
        ),
        "delay-found": FlagMeaning(
            "doubtful",
            "Under every law that the data support, the force is late by more than the declared timing allows.",
            "Calibrate the delay, or declare it.",
        ),
        "no-law": FlagMeaning(
            "note",
            "No law that was tried, with a delay of the force, describes G' and G'' within their uncertainty.",
            "Take the moduli as they are; of a fit, take a model with more memory.",
        ),
    }
