"""Reference instruments: tables of rheometers, DMAs and dynamometers, laws for them, agreement, material cards."""

from __future__ import annotations

from palpate import Command, FileSuggestion, ReportSection, plugin


@plugin
def palpate_commands() -> dict[str, Command]:
    """Return the commands of reference instruments."""
    return {
        "material": Command(
            "palpate_reference.material_command:material", "Tables of rheometers, DMAs, dynamometers.", "compare"
        ),
        "material fit": Command(
            "palpate_reference.fit_command:fit_material", "Laws for tables of a material.", "compare"
        ),
        "material master": Command(
            "palpate_reference.superposition.master_command:master", "One curve of several temperatures.", "compare"
        ),
        "material card": Command(
            "palpate_reference.cards.card_command:card", "A law for Abaqus, ANSYS, FEBio, COMSOL.", "share"
        ),
        "material agree": Command(
            "palpate_reference.agreement.agree_command:agree", "Compare runs with a reference instrument.", "compare"
        ),
    }


@plugin
def palpate_offers() -> dict[str, dict[str, FileSuggestion]]:
    """Return the suggestion for tables of instruments."""
    return {"file suggestion": {"instrument": FileSuggestion("palpate_reference.table_suggestion:suggested_commands")}}


@plugin
def palpate_report_sections() -> dict[str, ReportSection]:
    """Return the section on the agreement of a run with a reference."""
    return {"agreement": ReportSection("palpate_reference.agreement.agreement_lines:agreement_lines", order=82)}
