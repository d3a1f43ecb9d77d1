"""Studies over many runs: sweeps of settings, comparisons, repeatability, and the design of a palpation."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate import Command, plugin

if TYPE_CHECKING:
    from palpate import Settings


@plugin
def palpate_commands() -> dict[str, Command]:
    """Studies."""
    return {
        "compare": Command("palpate_studies.compare:compare", "Run every model with every estimator on one log."),
        "sweep": Command("palpate_studies.sweep.command:sweep", "Run every combination of settings, on all cores."),
        "repeat": Command("palpate_studies.repeat:repeat", "Statistics over many runs, and tests between groups."),
        "review": Command("palpate_studies.review:review", "Rate runs, and mark those to leave out."),
        "design": Command("palpate_studies.design.command:design", "Bounds of a palpation, and its best settings."),
    }


@plugin
def palpate_tables() -> dict[str, type[Settings]]:
    """Settings of a sweep, of a design, and of repeats."""
    from palpate_studies.design.settings import DesignSettings
    from palpate_studies.repeating import RepeatSettings
    from palpate_studies.sweep.settings import SweepSettings

    return {"sweep": SweepSettings, "design": DesignSettings, "repeat": RepeatSettings}
