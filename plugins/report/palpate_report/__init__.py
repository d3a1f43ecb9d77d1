"""The report: one self-contained page of a run, or of many, and pictures of a run fit for a paper."""

from __future__ import annotations

from palpate import Command, Diagnosis, Report, plugin


@plugin
def palpate_commands() -> dict[str, Command]:
    """Return the commands of report and pictures."""
    return {
        "report": Command(
            "palpate_report.report_command:report", "Write a one-page report on one run or many.", "share"
        ),
        "plot": Command(
            "palpate_report.plot_command:plot", "Draw figures of a run for a paper, with their data.", "share"
        ),
    }


@plugin
def palpate_offers() -> dict[str, dict[str, Report]]:
    """Return the report that `palpate run --report` writes."""
    return {"report": {"report": Report("palpate_report.report_command:write_report")}}


@plugin
def palpate_diagnoses() -> dict[str, Diagnosis]:
    """Return the autocorrelation of the innovations of each track, at the full rate of the samples."""
    return {"innovations": Diagnosis("palpate_report.whiteness:innovations")}
