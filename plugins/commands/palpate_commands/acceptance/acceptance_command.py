"""``palpate acceptance``: measure how this rig stops, step by step, and write a page to sign."""

from __future__ import annotations

import importlib.metadata
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from palpate import ConfigurationError, DeviceError, Force, clock, suggest
from palpate_engine import Pipeline, load_pipeline, make_folder, withdraw_folder, write_new
from palpate_kit.terminal.json_output import print_json
from palpate_kit.terminal.options import FolderOption, JsonOption, Overrides
from palpate_kit.terminal.table import Table, console
from pydantic import TypeAdapter, ValidationError

from palpate_commands.acceptance.job import ProcessJob
from palpate_commands.acceptance.outcome import Outcome
from palpate_commands.acceptance.page import Acceptance, row_of
from palpate_commands.acceptance.protocol import AcceptanceGuide, AcceptanceProtocol
from palpate_commands.acceptance.simulator import Simulator
from palpate_commands.acceptance.steps import STEPS, Visit, all_visits
from palpate_commands.acceptance.strokes import demand_limits
from palpate_commands.acceptance.watched_arm import WatchedArm

PAGE = "acceptance.md"
_FORCE = TypeAdapter(Force)


def acceptance(
    file: Annotated[Path, typer.Argument(help="The pipeline file of the rig.")],
    out: FolderOption = None,
    overrides: Overrides = None,
    step: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Only this step, such as estop or foam/force; can be repeated."),
    ] = None,
    stop_force: Annotated[
        str | None,
        typer.Option(metavar="FORCE", help="Force that stops the step `force`. [default: a quarter of stop_force]"),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Stop this very rig in every way, in free air, then on foam; compare it with [safety]; write a page to sign.

    The arm makes strokes within the limits of [safety], watched by a second connection, or recorded by the run where
    the controller serves one program. Emergency stop, safeguard, reflex and the sensor's cable are a person's; Ctrl-C,
    kill, SIGSTOP and the force are not. For the pipeline in the folder of a rehearsal all but the signals is done in
    simulated time. Exit code 1 where a stop is later, softer or longer than declared.
    """
    pipeline = load_pipeline(file, overrides or [])
    limits, visits = demand_limits(pipeline), _visits(step or [], pipeline)
    force = _stop_force(stop_force, limits.stop_force)
    guide, began = _guide(), datetime.fromtimestamp(clock().epoch_ns() / 1e9, UTC).astimezone()
    # A protocol that is refused leaves no folder.
    folder = make_folder("acceptance", out, began)
    start = partial(ProcessJob, file, overrides or [])
    protocol = AcceptanceProtocol(pipeline, folder, guide, start, force)
    try:
        protocol.refuse(visits)
    except ConfigurationError:
        withdraw_folder(folder)
        raise
    # Step by step; where one fails, the page has the steps before.
    outcomes: list[Outcome] = []
    try:
        for outcome in _outcomes(pipeline, folder, protocol, force, visits):
            outcomes.append(outcome)
            guide.say(f"  {', '.join(row_of(outcome)[2:])}")
    except (ConfigurationError, DeviceError, KeyboardInterrupt):
        if outcomes:  # what was measured until then counts
            _write(_acceptance(pipeline, file, began, protocol, outcomes), folder)
            guide.say(f"what was measured until then: {folder / PAGE}")
        raise
    _show(_acceptance(pipeline, file, began, protocol, outcomes), folder, as_json)


def _outcomes(
    pipeline: Pipeline, folder: Path, protocol: AcceptanceProtocol, force: float | None, visits: Sequence[Visit]
) -> Iterator[Outcome]:
    """Yield the outcome of each step: on the rig, or for the pipeline of a rehearsal in simulated time."""
    if pipeline.run.rehearsal is None:
        yield from protocol.outcomes(visits)
        return
    from palpate_commands.acceptance.rehearsal import rehearsed_outcomes

    say = _guide().say
    say(f"in simulated time; the twin {pipeline.run.rehearsal} does what a person would, and nothing real moves")
    for identity, outcome in rehearsed_outcomes(pipeline, folder, say, force, visits):
        protocol.identity = identity
        yield outcome


def _acceptance(
    pipeline: Pipeline, file: Path, began: datetime, protocol: AcceptanceProtocol, outcomes: Sequence[Outcome]
) -> Acceptance:
    """Return the page of the steps that were made so far."""
    return Acceptance(
        name=pipeline.run.name,
        file=str(file),
        began=began,
        version=importlib.metadata.version("palpate"),
        identity=protocol.identity,
        limits=demand_limits(pipeline),
        outcomes=tuple(outcomes),
        steps=_reported_visits(pipeline),
        rehearsal=pipeline.run.rehearsal,
        simulator=Simulator.of(pipeline),
        single_connection=WatchedArm.of(pipeline).modes.single_connection,
        looser_limits=pipeline.looser_limits,
    )


def _write(report: Acceptance, folder: Path) -> None:
    """Write the page to sign, and the same for programs."""
    import json

    write_new(folder / PAGE, report.text())
    write_new(folder / "acceptance.json", json.dumps(report.table(), indent=2, allow_nan=False) + "\n")


def _show(report: Acceptance, folder: Path, as_json: bool) -> None:
    """Write and show a report; raises DeviceError where the rig failed."""
    page = folder / PAGE
    _write(report, folder)
    if as_json:
        print_json(report.table())
    else:
        headings = ("step", "speed mm/s", "reaction ms", "deceleration m/s^2", "way mm", "verdict")
        rows = [(row[0], *row[2:]) for row in map(row_of, report.outcomes)]  # without the event, a sentence
        title = f"{report.name}: {report.verdict} (declared)"
        console().print(Table.of(title, headings, rows, ("step", "verdict")).view())
    typer.echo(f"{'to sign' if report.rehearsal is None else 'written to'}: {page}", err=as_json)
    if report.failed:
        names = ", ".join(outcome.visit.name for outcome in report.failed)
        raise DeviceError(f"the rig stops worse than [safety] declares, or was not measured: {names}; see {page}")


def _visits(names: Sequence[str], pipeline: Pipeline) -> tuple[Visit, ...]:
    """Return the steps by name, in the protocol's order, each at a site (a visit); raises ConfigurationError.

    Without names all that this robot reports, of a simulator all that it has, and in a rehearsal all without signals.
    """
    reported, simulator = _reported_visits(pipeline), Simulator.of(pipeline)
    possible = reported
    if simulator is not None:
        possible = tuple(visit for visit in reported if not simulator.lacks(visit))
    elif pipeline.run.rehearsal is not None:
        possible = tuple(visit for visit in reported if visit.step.number is None)
    for name in names:
        if not _has_step(all_visits(), name):
            raise ConfigurationError(f"--step {name}: no such step{suggest(name, STEPS)}")
        if not _has_step(reported, name):
            raise ConfigurationError(f"--step {name}: this robot does not report that stop")
        if not _has_step(possible, name):
            reason = "a signal needs the process of a run: it is not rehearsed"
            if simulator is not None:
                reason = f"the simulator {simulator.name} has no such stop"
            raise ConfigurationError(f"--step {name}: {reason}")
    chosen = tuple(visit for visit in possible if any(_is_called(name, visit) for name in names))
    return chosen if names else possible


def _has_step(visits: Sequence[Visit], name: str) -> bool:
    return any(_is_called(name, visit) for visit in visits)


def _is_called(name: str, visit: Visit) -> bool:
    return name in (visit.name, visit.step.name, visit.site)


def _reported_visits(pipeline: Pipeline) -> tuple[Visit, ...]:
    """Return the steps whose end this robot reports."""
    modes = WatchedArm.of(pipeline).modes
    return tuple(visit for visit in all_visits() if not visit.step.mode or getattr(modes, visit.step.mode))


def _stop_force(text: str | None, max_force: float) -> float | None:
    """Return the force [N] of `--stop-force`; raises ConfigurationError beyond 0 to `max_force`."""
    if text is None:
        return None
    try:
        force = float(_FORCE.validate_python(text.strip()))
    except (ValidationError, ConfigurationError) as error:
        raise ConfigurationError(f"--stop-force {text!r}: is not a force, such as 3 N") from error
    if not 0.0 < force <= max_force:
        allowed = f"from above 0 up to [safety] stop_force = {max_force:g} N is allowed"
        raise ConfigurationError(f"--stop-force {text!r}: {allowed}")
    return force


def _guide() -> AcceptanceGuide:
    """Return the guide that writes to the terminal and waits for Enter."""
    from rich.console import Console

    errors = Console(stderr=True, markup=False, emoji=False)

    def say(text: str) -> None:
        errors.print(text, highlight=False, markup=False, soft_wrap=True)

    return AcceptanceGuide(say, _ask)


def _ask(text: str) -> None:
    """Return once a person has pressed Enter; raises ConfigurationError without one."""
    try:
        typer.prompt(f"{text}; then press Enter", default="", show_default=False, prompt_suffix=" ", err=True)
    except (EOFError, typer.Abort) as error:
        raise ConfigurationError("no answer: the acceptance needs a person at the rig") from error
