"""``palpate acceptance``: measure how this rig stops, step by step, and write a page to sign."""

from __future__ import annotations

import importlib.metadata
from collections.abc import Callable, Iterator, Sequence
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
    folder = make_folder("acceptance", out, began)
    start = partial(ProcessJob, file, overrides or [])
    protocol = AcceptanceProtocol(pipeline, folder, guide, start, force)
    outcomes: list[Outcome] = []
    try:
        protocol.refuse(visits)
    except ConfigurationError:
        withdraw_folder(folder)
        raise
    try:
        for outcome in _outcomes(pipeline, folder, protocol, force, visits):
            outcomes.append(outcome)
            guide.say(f"  {', '.join(row_of(outcome)[2:])}")
    except (ConfigurationError, DeviceError, KeyboardInterrupt):
        if outcomes:  # what was measured until then counts
            _write(_acceptance(pipeline, file, began, protocol, outcomes), folder)
            guide.say(f"what was measured until then: {folder / PAGE}")
        raise
    _tell(_acceptance(pipeline, file, began, protocol, outcomes), folder, as_json)


def _outcomes(
    pipeline: Pipeline, folder: Path, protocol: AcceptanceProtocol, force: float | None, visits: Sequence[Visit]
) -> Iterator[Outcome]:
    """One step after the other: on the rig, or for the pipeline of a rehearsal in simulated time."""
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
    return Acceptance(
        pipeline.run.name,
        str(file),
        began,
        importlib.metadata.version("palpate"),
        protocol.identity,
        demand_limits(pipeline),
        tuple(outcomes),
        _able(pipeline),
        pipeline.run.rehearsal,
        Simulator.of(pipeline),
        WatchedArm.of(pipeline).modes.single_connection,
        pipeline.looser_limits,
    )


def _write(found: Acceptance, folder: Path) -> None:
    """The page to sign, and the same for programs."""
    import json

    write_new(folder / PAGE, found.text())
    write_new(folder / "acceptance.json", json.dumps(found.table(), indent=2, allow_nan=False) + "\n")


def _tell(found: Acceptance, folder: Path, as_json: bool) -> None:
    """Write and show it; raises DeviceError where the rig failed."""
    page = folder / PAGE
    _write(found, folder)
    if as_json:
        print_json(found.table())
    else:
        headings = ("step", "speed mm/s", "reaction ms", "deceleration m/s^2", "way mm", "verdict")
        rows = [(row[0], *row[2:]) for row in map(row_of, found.outcomes)]
        console().print(
            Table.of(f"{found.name}: {found.verdict} (declared)", headings, rows, ("step", "verdict")).view()
        )
    typer.echo(f"{'to sign' if found.rehearsal is None else 'written to'}: {page}", err=as_json)
    if found.failed:
        names = ", ".join(outcome.visit.name for outcome in found.failed)
        raise DeviceError(f"the rig stops worse than [safety] declares, or was not measured: {names}; see {page}")


def _visits(names: Sequence[str], pipeline: Pipeline) -> tuple[Visit, ...]:
    """The steps by name, in the protocol's order; raises ConfigurationError.

    Without names all that this robot reports, of a simulator all that it has, and in a rehearsal all without signals.
    """
    able, simulator = _able(pipeline), Simulator.of(pipeline)
    every = able if pipeline.run.rehearsal is None else tuple(visit for visit in able if visit.step.number is None)
    if simulator is not None:
        every = tuple(visit for visit in able if not simulator.lacks(visit))
    for name in names:
        if not any(map(partial(_is_called, name), all_visits())):
            raise ConfigurationError(f"--step {name}: no such step{suggest(name, STEPS)}")
        if not any(map(partial(_is_called, name), able)):
            raise ConfigurationError(f"--step {name}: this robot does not report that stop")
        if not any(map(partial(_is_called, name), every)):
            absent = "a signal needs the process of a run: it is not rehearsed"
            if simulator is not None:
                absent = f"the simulator {simulator.name} has no such stop"
            raise ConfigurationError(f"--step {name}: {absent}")
    chosen = tuple(visit for visit in every if any(_is_called(name, visit) for name in names))
    return chosen if names else every


def _is_called(name: str, visit: Visit) -> bool:
    return name in (visit.name, visit.step.name, visit.site)


def _able(pipeline: Pipeline) -> tuple[Visit, ...]:
    """The steps whose end this robot reports."""
    modes = WatchedArm.of(pipeline).modes
    return tuple(visit for visit in all_visits() if not visit.step.mode or getattr(modes, visit.step.mode))


def _stop_force(text: str | None, most: float) -> float | None:
    if text is None:
        return None
    try:
        force = float(_FORCE.validate_python(text.strip()))
    except (ValidationError, ConfigurationError) as error:
        raise ConfigurationError(f"--stop-force {text!r}: is not a force, such as 3 N") from error
    if not 0.0 < force <= most:
        raise ConfigurationError(
            f"--stop-force {text!r}: from above 0 up to [safety] stop_force = {most:g} N is allowed"
        )
    return force


def _guide() -> AcceptanceGuide:
    from rich.console import Console

    errors = Console(stderr=True, markup=False, emoji=False)

    def say(text: str) -> None:
        errors.print(text, highlight=False, markup=False, soft_wrap=True)

    return AcceptanceGuide(say, _asks())


def _asks() -> Callable[[str], None]:
    def ask(text: str) -> None:
        try:
            typer.prompt(f"{text}; then press Enter", default="", show_default=False, prompt_suffix=" ", err=True)
        except (EOFError, typer.Abort) as error:
            raise ConfigurationError("no answer: the acceptance needs a person at the rig") from error

    return ask
