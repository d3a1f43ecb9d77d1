"""Reference instruments: tables of rheometers, DMAs and dynamometers, laws for them, agreement, material cards."""

from __future__ import annotations

from palpate import Command, plugin


@plugin
def palpate_commands() -> dict[str, Command]:
    """Their commands."""
    return {
        "material": Command(
            "palpate_reference.material_command:material", "Tables of rheometers, DMAs, dynamometers.", "compare"
        ),
        "material fit": Command(
            "palpate_reference.fit_command:fit_material", "Laws for tables of a material.", "compare"
        ),
    }
