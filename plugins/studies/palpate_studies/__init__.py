"""Studies over many runs: sweeps of settings, and repeatability."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate import Command, plugin

if TYPE_CHECKING:
    from palpate import Settings


@plugin
def palpate_commands() -> dict[str, Command]:
    """Return the commands of studies."""
    return {
        "sweep": Command(
            "palpate_studies.sweep.sweep_command:sweep", "Run every combination of settings, on all cores.", "compare"
        ),
        "bench": Command(
            "palpate_studies.bench.bench_command:bench", "Compare filters and models on many records.", "compare"
        ),
        "repeat": Command(
            "palpate_studies.repeat_command:repeat",
            "Summarise many runs, and test groups against each other.",
            "compare",
        ),
        "repeat review": Command("palpate_studies.review_command:review", "Rate runs, and mark those to leave out."),
        "pack": Command(
            "palpate_studies.archive.pack_command:pack", "A folder of fits as one file that others can check.", "share"
        ),
        "verify": Command(
            "palpate_studies.archive.verify_command:verify", "Make a packed study again, and compare.", "share"
        ),
    }


@plugin
def palpate_tables() -> dict[str, type[Settings]]:
    """Return the tables of a bench, of a sweep, and of repeats."""
    from palpate_studies.bench.settings import MeasureSettings
    from palpate_studies.repeat_settings import RepeatSettings
    from palpate_studies.sweep.settings import SweepSettings

    return {"bench": MeasureSettings, "sweep": SweepSettings, "repeat": RepeatSettings}
