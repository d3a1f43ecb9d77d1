"""Control of a rig: checks on a reference of known stiffness, their chart, and the latest check before a run."""

from __future__ import annotations

from palpate import Command, ControlReader, FlagMeaning, ReportSection, plugin


@plugin
def palpate_commands() -> dict[str, Command]:
    """Return the command that checks a rig."""
    return {
        "calibrate control": Command(
            "palpate_control.control_command:control", "Check a rig against a reference of known stiffness.", "hardware"
        )
    }


@plugin
def palpate_offers() -> dict[str, dict[str, ControlReader]]:
    """Return the reader of the chart that a run names."""
    return {"control chart": {"control": ControlReader("palpate_control.chart_use:chart_use")}}


@plugin
def palpate_report_sections() -> dict[str, ReportSection]:
    """Return the line of that check in a result."""
    return {"control": ReportSection("palpate_control.check_line:check_lines", order=81)}


@plugin
def palpate_flags() -> dict[str, FlagMeaning]:
    """Return the meaning of its flag."""
    return {
        "out-of-control": FlagMeaning(
            "doubtful",
            "The last check of the rig is out of control, or was made with another tip, sensor or robot.",
            "Find out what changed (docs: control), and check again before the next run.",
        )
    }
