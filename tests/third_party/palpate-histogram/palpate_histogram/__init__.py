"""A histogram of an estimate over runs: a command, a table of the pipeline file, a report section and a template."""

from palpate import Command, ReportSection, Settings, Template, plugin
from pydantic import Field


class HistogramSettings(Settings):
    """How the histogram is made."""

    bins: int = Field(default=5, ge=1, description="how many bins")


@plugin
def palpate_commands():
    """The histogram."""
    return {"histogram": Command("palpate_histogram.command:histogram", "Histogram of an estimate over runs.")}


@plugin
def palpate_tables():
    """Its settings."""
    return {"histogram": HistogramSettings}


@plugin
def palpate_report_sections():
    """How a run compares with what is usual."""
    return {"histogram": ReportSection("palpate_histogram.command:section")}


@plugin
def palpate_templates():
    """Its table, to be filled in."""
    return {"histogram": Template("palpate_histogram", "histogram.toml", "the table [histogram]")}
