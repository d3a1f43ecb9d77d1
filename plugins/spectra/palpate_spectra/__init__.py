"""Spectra: moduli over frequency, from oscillations in contact; over time, from ramps and holds."""

from __future__ import annotations

from palpate import Command, FlagMeaning, plugin


@plugin
def palpate_commands() -> dict[str, Command]:
    """Return the commands of spectra."""
    return {
        "fit spectrum": Command(
            "palpate_spectra.spectrum_command:spectrum", "Storage and loss modulus over frequency.", "run"
        ),
        "fit relaxation": Command(
            "palpate_spectra.transient.relaxation_command:relaxation",
            "Relaxation modulus or creep compliance.",
            "run",
        ),
    }


@plugin
def palpate_flags() -> dict[str, FlagMeaning]:
    """Return the flags of spectra with their meanings."""
    return {
        "harmonics": FlagMeaning(
            "doubtful",
            "The force has multiples or sums of the motion's frequencies that the tip's law does not explain.",
            "Use a smaller amplitude, another tip or thickness, or find out what rattles or slips.",
        ),
        "kramers-kronig": FlagMeaning(
            "doubtful",
            "G' and G'' over frequency are not those of one causal, passive, linear material.",
            "Check the tip's mass, delays and series_stiffness; take recordings of one specimen at one depth only.",
        ),
        "loss-not-distinguishable": FlagMeaning.sign(
            "delay-unclear",
            "The declared uncertainty of timing alone could explain the loss modulus at this frequency.",
        ),
        "delay-found": FlagMeaning.sign(
            "delay-unclear",
            "Under every law that the data support, the force is late by more than the declared timing allows.",
        ),
        "not-linear-viscoelastic": FlagMeaning(
            "doubtful",
            "No linear relaxing material explains both the ramp and the hold of the record with this tip.",
            "Check tip, layer and surface; hold two depths: a poroelastic material relaxes more slowly at the larger.",
        ),
        "ramp-long": FlagMeaning(
            "note",
            "The first points after a ramp are corrected for its duration by more than 5 %, by the fitted spectrum.",
            "Use the points after a few ramp durations, or make the ramp faster.",
        ),
        "drift-unknown": FlagMeaning(
            "note",
            "The record ends before the tip is in free air again, so a drift of the force cannot be determined.",
            "Record until the tip has left the material and stood still in air.",
        ),
        "no-law": FlagMeaning(
            "note",
            "No law that was tried, with a delay of the force, describes G' and G'' within their uncertainty.",
            "Use the moduli as they are; for a fit, use a model with more memory.",
        ),
    }
