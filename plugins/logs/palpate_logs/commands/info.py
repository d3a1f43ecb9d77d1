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
        given = {"force": force, "position": position, "velocity": velocity, "time": time, "rate": rate}
        given["lateral"] = lateral
        choices = {role: text for role, text in given.items() if text is not None}
        if not choices and picture is None and (lines := file_suggestion(log)) is not None:
            _show_commands(log, lines, out, as_json)
        elif is_folder_of_logs(log) and picture is None:
            suggest_folder(log, choices, out, as_json)
        else:
            _suggest(log, choices, out, picture, as_json)
        return
    if is_folder_of_logs(log):
        raise LogError(f"{log}: is a folder; with --suggest, palpate says how the logs in it are read")
    system = system_at(str(log))
    with progress(f"info of {log.name}", "messages"):
        survey = recording_of(log).survey(log) if system is None else system.survey()
    if as_json:
        print_json(survey)
    else:
        console(160).print(survey_view(survey))


def file_suggestion(path: Path) -> Sequence[str] | None:
    """What a plugin says of a file that is not a log; None where none knows it."""
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


def _suggest(log: Path, choices: dict[str, str], out: Path | None, picture: Path | None, as_json: bool) -> None:
    """Print or write the pipeline, and list on standard error what in it is a guess or must be filled in."""
    system = system_at(str(log))
    carried = read_run_log(log) if system is None else None
    if carried is not None and not choices and picture is None:
        typer.echo(f"{log}: tip, models, estimators and alignment are those of its run", err=True)
        _written(_approved_text(replay_source(carried), log), out, as_json)
        return
    with progress(f"look at {log.name}", "messages"):
        suggestion = suggestion_of(log, choices) if system is None else system.suggest(choices)
    if note := rate_note(choices, [suggestion]):
        typer.echo(note, err=True)
    for text in suggestion.blanks:
        typer.echo(f"fill in: {printable(text)}", err=True)
    for text in suggestion.doubts:
        typer.echo(f"check: {printable(text)}", err=True)
    if picture is not None:
        draw_suggestion(suggestion, printable(log.name), picture)
    if carried is not None:
        chosen = f"all but {', '.join(choices)}" if choices else "all"
        typer.echo(f"{log}: {chosen} is that of its run", err=True)
        text = _approved_text(with_other_channels(carried, suggestion, choices), log)
    else:
        beside = out.parent if out is not None and system is None else None
        text = pipeline_of(suggestion, log if system is None else Path(system.name), beside)
    _written(text, out, as_json, suggestion)


def _approved_text(source: Source, log: Path) -> str:
    """The pipeline of a log as a text; whoever runs it consents to the plugin files in it, so they must be approved."""
    plugin_files(source)
    return run_log_text(source, log)


def _written(text: str, out: Path | None, as_json: bool, suggestion: Suggestion | None = None) -> None:
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
    """The table of topics, and what is wrong."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    table = Table(title=printable(f"{survey.path} ({survey.format})"), title_justify="left")
    for heading in ("topic", "type"):
        table.add_column(heading, overflow="fold")
    for heading in ("messages", "rate\nHz", "interval ms\n1 % to 99 %", "gaps", "longest\nms", "late ms\n50 %, 99 %"):
        table.add_column(heading, justify="right")
    for topic in survey.topics:
        table.add_row(*(Text(cell) for cell in _cells(topic)))
    notes = [
        Text(f"  {_name(topic)}: {printable(topic.note)}", style="yellow") for topic in survey.topics if topic.note
    ]
    notes += [Text(f"  {printable(note)}", style="yellow") for note in survey.notes]
    return Group(_span(survey), table, *_numbers(survey), *([Text("notes")] if notes else []), *notes)


def _name(topic: TopicSurvey) -> str:
    return printable(topic.name)


def _numbers(survey: Survey) -> list[RenderableType]:
    """Every number that signals can name, with its statistics where it has been decoded."""
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
        known = {number.name for number in topic.numbers}
        rest = [name for name in topic.fields if name not in known and not name.endswith("]")]
        for number in topic.numbers:
            cells = (f"{x:.4g}" for x in (number.low, number.high, number.std, number.noise))
            odd = str(number.odd) if number.odd else ""
            table.add_row(Text(printable(f"{topic.name}:{number.name}")), *cells, odd, number.course)
        for name in rest:
            table.add_row(Text(printable(f"{topic.name}:{name}")))
    return [table]


def _span(survey: Survey) -> str:
    filled = [topic for topic in survey.topics if topic.messages]
    if not filled:
        return "no messages"
    first, last = min(t.first for t in filled), max(t.last for t in filled)
    return f"{sum(t.messages for t in filled)} messages over {(last - first) / 1e9:.3f} s, from {first / 1e9:.3f} s"


def _cells(topic: TopicSurvey) -> list[str]:
    cells = [_name(topic), printable(topic.type or topic.encoding), str(topic.messages)]
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
