"""``palpate info LOG``: what a log holds, and a pipeline that reads it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate import registry as registries
from palpate.cli.info import show_installation
from palpate.errors import LogError
from palpate.recording import Recording, Suggestion, Survey, TopicSurvey

if TYPE_CHECKING:
    from rich.console import RenderableType

_REST = """
# The tip, the model and the filter are for you to say; these are the paper's.
[indenter.tip]
type = "sphere"
radius = "5 mm"

[model.dr]
type = "dimensionality-reduction"
indenter = "tip"
poisson = 0.5

[estimator.ekf]
type = "ekf"

[estimator.fit]                        # all of the record at once: for `palpate fit`, too
type = "casadi-fit"
"""


def info(
    log: Annotated[Path | None, typer.Argument(help="The log: .mcap, .db3, a bag folder, .csv.")] = None,
    suggest: Annotated[bool, typer.Option("--suggest", help="Print a ready pipeline that reads the log.")] = False,
    force: Annotated[str | None, typer.Option(metavar="TOPIC:FIELD", help="What is the force.")] = None,
    position: Annotated[str | None, typer.Option(metavar="TOPIC:FIELD", help="What is the position.")] = None,
    velocity: Annotated[str | None, typer.Option(metavar="TOPIC:FIELD", help="What is the velocity.")] = None,
    time: Annotated[str | None, typer.Option(metavar="COLUMN", help="What is the time in a CSV file.")] = None,
    rate: Annotated[str | None, typer.Option(help="Rate of a CSV file without a time, such as '500 Hz'.")] = None,
) -> None:
    """Say what a log holds, with --suggest as a pipeline that reads it; without a log, what palpate runs on."""
    from rich.console import Console

    if log is None:
        show_installation()
        return
    recording = recording_of(log)
    if suggest:
        given = {"force": force, "position": position, "velocity": velocity, "time": time, "rate": rate}
        choices = {role: text for role, text in given.items() if text is not None}
        typer.echo(pipeline_text(recording.suggest(log, choices), log), nl=False)
        return
    console = Console()
    if not console.is_terminal:
        console = Console(width=160)
    console.print(survey_view(recording.survey(log)))


def recording_of(log: Path) -> type[Recording]:
    """The device that reads logs of this format; raises LogError where there is none."""
    if not log.exists():
        raise LogError(f"{log}: there is no such file")
    entries = registries.load().parts["device"]
    readers = {name: entry.part for name, entry in entries.items() if issubclass(entry.part, Recording)}
    for part in readers.values():
        if part.recognises(log):
            return part
    raise LogError(f"{log}: no device reads such a log (those that read logs: {', '.join(sorted(readers))})")


def pipeline_text(suggestion: Suggestion, log: Path) -> str:
    """A whole pipeline in TOML, with the reasons of what was chosen."""
    reasons = (f"A pipeline for {log.name}. What was found, and why:", *(f"  {text}" for text in suggestion.reasons))
    lines = [f"# {_printable(reason)}" for reason in reasons]
    lines += ["", "[run]", f"name = {_toml(log.name)}", "", "[device.log]"]
    tables = {key: value for key, value in suggestion.device.items() if key in ("signals", "columns")}
    lines += [f"{key} = {_toml(value)}" for key, value in suggestion.device.items() if key not in tables]
    for key, table in tables.items():
        lines += ["", f"[device.log.{key}]", *(f"{name} = {_toml(item)}" for name, item in table.items())]
    lines += [
        "",
        '# Timing moves the viscosity: declare what is known of it, as in delay = "0 ms", uncertainty = "1 ms".',
    ]
    lines += ["[alignment]"]
    lines += [f"{key} = {_toml(value)}" for key, value in suggestion.alignment.items()]
    lines += ['tip_mass = "140 g"                     # all that hangs behind the sensor: weigh it']
    return "\n".join(lines) + "\n" + _REST


def _toml(value: Any) -> str:
    """A value on one line."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_toml(item)}" for key, item in value.items()) + " }"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    escaped = str(value).replace("\\", "\\\\").replace('"', '\\"')
    return f'"{_printable(escaped)}"'


def _printable(text: str) -> str:
    """The text with what is no visible character spelled out, so that it stays on its line."""
    return "".join(c if c.isprintable() else f"\\u{ord(c):04x}" for c in text)


def survey_view(survey: Survey) -> RenderableType:
    """The table of topics, and what is amiss."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    table = Table(title=f"{survey.path} ({survey.format})", title_justify="left")
    for heading in ("topic", "type"):
        table.add_column(heading, overflow="fold")
    for heading in ("messages", "rate\nHz", "interval ms\n1 % to 99 %", "gaps", "longest\nms", "late ms\n50 %, 99 %"):
        table.add_column(heading, justify="right")
    for topic in survey.topics:
        table.add_row(*(Text(cell) for cell in _cells(topic)))
    lines = [Text(f"  {topic.name}: {', '.join(topic.fields)}") for topic in survey.topics if topic.fields]
    head = [Text("numbers that signals can name")] if lines else []
    notes = [Text(f"  {topic.name}: {topic.note}", style="yellow") for topic in survey.topics if topic.note]
    notes += [Text(f"  {note}", style="yellow") for note in survey.notes]
    return Group(_span(survey), table, *head, *lines, *([Text("notes")] if notes else []), *notes)


def _span(survey: Survey) -> str:
    filled = [topic for topic in survey.topics if topic.messages]
    if not filled:
        return "no messages"
    first, last = min(t.first for t in filled), max(t.last for t in filled)
    return f"{sum(t.messages for t in filled)} messages over {(last - first) / 1e9:.3f} s, from {first / 1e9:.3f} s"


def _cells(topic: TopicSurvey) -> list[str]:
    cells = [topic.name, topic.type or topic.encoding, str(topic.messages)]
    if topic.interval is None:
        return [*cells, "", "", "", "", _late(topic)]
    low, _, high = topic.interval
    rate = f"{(topic.messages - 1) * 1e9 / (topic.last - topic.first):.1f}" if topic.last > topic.first else ""
    return [
        *cells,
        rate,
        f"{low * 1e3:.2f} to {high * 1e3:.2f}",
        str(topic.gaps),
        f"{topic.longest * 1e3:.1f}",
        _late(topic),
    ]


def _late(topic: TopicSurvey) -> str:
    return "" if topic.lateness is None else f"{topic.lateness[0] * 1e3:.2f}, {topic.lateness[1] * 1e3:.2f}"
