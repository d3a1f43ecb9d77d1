"""``palpate info LOG``: the contents of a log, and a pipeline that reads it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from palpate import ConfigurationError, LogError, OutputError, printable
from palpate_engine import Source, function_of, plugin_files, registry as registries
from palpate_kit.logs.draft_pipeline import pipeline_of, rate_note, recording_of, suggestion_of, system_at
from palpate_kit.runs.replay_source import read_run_log, replay_source, run_log_text, with_other_channels
from palpate_kit.terminal.json_output import print_json
from palpate_kit.terminal.options import JsonOption
from palpate_kit.terminal.progress import progress
from palpate_kit.terminal.table import console
from palpate_records.recording import Suggestion, Survey, TopicSurvey

from palpate_logs.commands.folder_suggestion import is_folder_of_logs, suggest_folder
from palpate_logs.commands.installation import show_installation
from palpate_logs.suggestion_figure import draw_suggestion

if TYPE_CHECKING:
    from rich.console import RenderableType

_SECOND = 1e9  # [ns]
_WIDTH = 160  # characters of a line, a choice: that of the table of topics


def info(
    log: Annotated[
        Path | None,
        typer.Argument(
            help="The log: .mcap, .db3, a bag folder, .csv; a folder of logs, with --suggest; or ros2://DOMAIN."
        ),
    ] = None,
    suggest: Annotated[bool, typer.Option("--suggest", help="Print a ready pipeline that reads the log.")] = False,
    force: Annotated[str | None, typer.Option(metavar="TOPIC:FIELD", help="Source of the force.")] = None,
    position: Annotated[str | None, typer.Option(metavar="TOPIC:FIELD", help="Source of the position.")] = None,
    velocity: Annotated[str | None, typer.Option(metavar="TOPIC:FIELD", help="Source of the velocity.")] = None,
    time: Annotated[str | None, typer.Option(metavar="COLUMN", help="Column of the time in a CSV file.")] = None,
    lateral: Annotated[
        str | None,
        typer.Option(metavar="COLUMN[,COLUMN]", help="Of a table: the place along the skin, or its x and y."),
    ] = None,
    rate: Annotated[str | None, typer.Option(help="Rate of a CSV file without a time, such as '500 Hz'.")] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Write the suggested pipeline there; the log's path is right from there."),
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(help="Draw the signals taken as force and motion, .png or .svg."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Show what a log contains, with --suggest a pipeline that reads it; without a log, what palpate runs on."""
    if log is None:
        show_installation(as_json)
        return
    if suggest or out is not None or picture is not None:
        options = {"force": force, "position": position, "velocity": velocity}
        options |= {"time": time, "rate": rate, "lateral": lateral}
        choices = {key: text for key, text in options.items() if text is not None}
        commands = file_suggestion(log) if not choices and picture is None else None
        if commands is not None:
            _show_commands(log, commands, out, as_json)
        elif is_folder_of_logs(log) and picture is None:
            suggest_folder(log, choices, out, as_json)
        else:
            _suggest_pipeline(log, choices, out, picture, as_json)
        return
    if is_folder_of_logs(log):
        raise LogError(f"{log}: is a folder; with --suggest, palpate says how the logs in it are read")
    system = system_at(str(log))
    with progress(f"info of {log.name}", "messages"):
        survey = recording_of(log).survey(log) if system is None else system.survey()
    if as_json:
        print_json(survey)
    else:
        console(_WIDTH).print(survey_view(survey))


def file_suggestion(path: Path) -> Sequence[str] | None:
    """Return the commands that a plugin suggests for a file that is not a log; None if none knows it."""
    if not path.is_file():
        return None
    offers = registries.load().file_suggestions.values()
    answers = (function_of(offer)(path) for offer in offers)
    return next((answer for answer in answers if answer is not None), None)


def _show_commands(path: Path, lines: Sequence[str], out: Path | None, as_json: bool) -> None:
    """Print commands for a file that no pipeline reads; raises ConfigurationError where a pipeline is asked for."""
    if out is not None:
        raise ConfigurationError(f"{path}: is not a log: no pipeline reads it (see palpate info {path} --suggest)")
    if as_json:
        print_json({"commands": [line for line in lines if not line.startswith("#")], "lines": list(lines)})
        return
    for line in lines:
        typer.echo(printable(line))


def _suggest_pipeline(
    log: Path, choices: dict[str, str], out: Path | None, picture: Path | None, as_json: bool
) -> None:
    """Print or write the pipeline, and list on standard error what in it is a guess or must be filled in.

    A log of a run carries its pipeline, which is taken, but for the channels that a person chooses.
    """
    system = system_at(str(log))  # a running one, at an address in place of a log
    run_log = read_run_log(log) if system is None else None
    if run_log is not None and not choices and picture is None:
        typer.echo(f"{log}: tip, models, estimators and alignment are those of its run", err=True)
        _write_pipeline(_approved_text(replay_source(run_log), log), out, as_json)
        return
    with progress(f"look at {log.name}", "messages"):
        suggestion = suggestion_of(log, choices) if system is None else system.suggest(choices)
    note = rate_note(choices, [suggestion])
    if note:
        typer.echo(note, err=True)
    # What a person must state, and what to check.
    for text in suggestion.blanks:
        typer.echo(f"fill in: {printable(text)}", err=True)
    for text in suggestion.doubts:
        typer.echo(f"check: {printable(text)}", err=True)
    if picture is not None:
        draw_suggestion(suggestion, printable(log.name), picture)
    # The pipeline of the run with other channels, else one of the suggestion.
    if run_log is not None:
        kept_keys = f"all but {', '.join(choices)}" if choices else "all"
        typer.echo(f"{log}: {kept_keys} is that of its run", err=True)
        text = _approved_text(with_other_channels(run_log, suggestion, choices), log)
    else:
        folder = out.parent if out is not None and system is None else None
        text = pipeline_of(suggestion, log if system is None else Path(system.name), folder)
    _write_pipeline(text, out, as_json, suggestion)


def _approved_text(source: Source, log: Path) -> str:
    """Return the pipeline of a log as a text.

    Whoever runs it consents to the plugin files in it: raises ConsentError if one of them is not approved.
    """
    plugin_files(source)
    return run_log_text(source, log)


def _write_pipeline(text: str, out: Path | None, as_json: bool, suggestion: Suggestion | None = None) -> None:
    """Write the text of a pipeline to a new file, else print it; raises OutputError if the file cannot be written.

    As JSON, it is printed with the tables and sentences of its suggestion.
    """
    if as_json:
        names = ("device", "alignment", "reasons", "doubts", "blanks", "hints")
        print_json({"pipeline": text, **{name: getattr(suggestion, name, None) for name in names}})
    if out is None:
        if not as_json:
            typer.echo(text, nl=False)
        return
    try:
        with out.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError as error:
        raise OutputError(f"{out}: exists already, and nothing is ever overwritten") from error
    except OSError as error:
        raise OutputError(f"{out}: cannot write: {error.strerror}") from error
    typer.echo(f"the pipeline is in {out}; run it with: palpate run {out}", err=as_json)


def survey_view(survey: Survey) -> RenderableType:
    """Return the table of topics, that of their numbers, and the notes."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    table = Table(title=printable(f"{survey.path} ({survey.format})"), title_justify="left")
    for heading in ("topic", "type"):
        table.add_column(heading, overflow="fold")
    for heading in ("messages", "rate\nHz", "interval ms\n1 % to 99 %", "gaps", "longest\nms", "late ms\n50 %, 99 %"):
        table.add_column(heading, justify="right")
    for topic in survey.topics:
        table.add_row(*(Text(cell) for cell in _topic_cells(topic)))
    notes = [f"{printable(topic.name)}: {printable(topic.note)}" for topic in survey.topics if topic.note]
    notes += [printable(note) for note in survey.notes]
    note_lines = [Text(f"  {note}", style="yellow") for note in notes]
    notes_title = [Text("notes")] if notes else []
    return Group(_span_text(survey), table, *_number_tables(survey), *notes_title, *note_lines)


def _number_tables(survey: Survey) -> list[RenderableType]:
    """Return the table of the numbers that signals can name, with their statistics if they were decoded.

    Empty for a survey without such numbers; elements of an array, whose names end in "]", are only named if decoded.
    """
    from rich.table import Table
    from rich.text import Text

    if not any(topic.fields for topic in survey.topics):
        return []
    table = Table(title="numbers that signals can name", title_justify="left")
    table.add_column("number", overflow="fold")
    for heading in ("from", "to", "std", "noise", "not finite"):
        table.add_column(heading, justify="right")
    table.add_column("course", no_wrap=True)
    for topic in survey.topics:
        for number in topic.numbers:
            statistics = [f"{quantity:.4g}" for quantity in (number.low, number.high, number.std, number.noise)]
            odd_count = str(number.odd) if number.odd else ""
            table.add_row(Text(printable(f"{topic.name}:{number.name}")), *statistics, odd_count, number.course)
        decoded_names = {number.name for number in topic.numbers}
        for name in topic.fields:
            if name not in decoded_names and not name.endswith("]"):
                table.add_row(Text(printable(f"{topic.name}:{name}")))
    return [table]


def _span_text(survey: Survey) -> str:
    """Return the number of messages of all topics and the time that they span, in seconds."""
    topics = [topic for topic in survey.topics if topic.messages]
    if not topics:
        return "no messages"
    message_count = sum(topic.messages for topic in topics)
    first = min(topic.first for topic in topics)
    last = max(topic.last for topic in topics)
    return f"{message_count} messages over {(last - first) / _SECOND:.3f} s, from {first / _SECOND:.3f} s"


def _topic_cells(topic: TopicSurvey) -> list[str]:
    """Return the row of a topic: name, type, messages, rate [Hz], interval [ms], gaps, longest pause and lateness [ms].

    Cells of statistics are empty for a topic without them.
    """
    name_cells = [printable(topic.name), printable(topic.type or topic.encoding), str(topic.messages)]
    lateness = ""
    if topic.lateness is not None:
        median, high_lateness = topic.lateness
        lateness = f"{median * 1e3:.2f}, {high_lateness * 1e3:.2f}"
    if topic.interval is None:
        return [*name_cells, "", "", "", "", lateness]
    low, _, high = topic.interval
    rate = ""
    if topic.last > topic.first:
        rate = f"{(topic.messages - 1) * _SECOND / (topic.last - topic.first):.1f}"
    interval, longest = f"{low * 1e3:.2f} to {high * 1e3:.2f}", f"{topic.longest * 1e3:.1f}"
    return [*name_cells, rate, interval, str(topic.gaps), longest, lateness]
