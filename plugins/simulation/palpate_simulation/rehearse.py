"""``palpate rehearse``: the pipeline of a robot in simulated time, against the twin of its rig."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer
from palpate import ArmTruth, ConfigurationError, DeviceError, HoldUp, SimulatedTwin, Time, Twin, suggest
from palpate_engine import Pipeline, Result, SafetySettings, load_pipeline, run_pipeline
from palpate_kit.terminal.options import DetailsOption, FolderOption, Overrides
from palpate_kit.terminal.result_screen import WIDTH, print_view
from palpate_kit.terminal.result_summary import result_views
from palpate_kit.terminal.table import Table, console
from pydantic import TypeAdapter, ValidationError

PROCESSES = ("robot", "sensor", "main")
HOLD_UP = re.compile(r"(?P<process>\w+)\s+(?P<duration>[\d.]+\s*\w+)(\s+every\s+(?P<period>[\d.]+\s*\w+))?")
TIME = TypeAdapter(Time)
DETAILS_WIDTH = 120  # columns of the tables with all details (a choice)
TWIN_PREFIX = "twin.*."  # of an override for whatever twin the rig has


def rehearse(
    file: Annotated[Path, typer.Argument(help="The pipeline file of a rig.")],
    out: FolderOption = None,
    overrides: Overrides = None,
    specimen: Annotated[
        list[str] | None,
        typer.Option(metavar="KEY=VALUE", help="What the tip presses on: elasticity, viscosity, surface, ..."),
    ] = None,
    fault: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME@TIME", help='A fault at a time of the record, such as "protective-stop@3 s".'),
    ] = None,
    hold_up: Annotated[
        list[str] | None,
        typer.Option(
            metavar="WHO", help='A busy computer, such as "robot 8 ms every 1 s"; WHO is robot, sensor or main.'
        ),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of the twin's noise.", min=0)] = 0,
    details: DetailsOption = False,
) -> None:
    """Run the pipeline of a robot in simulated time: nothing real moves, and every time it goes the same way."""
    pipeline = load_rehearsal(file, [*(overrides or []), *_specimen_overrides(specimen or [])])
    (twin,) = pipeline.twins.values()
    hold_ups = [_parse_hold_up(text) for text in hold_up or []]
    faults = _parse_faults(fault or [])
    rehearsal = {"faults": fault or [], "hold_ups": hold_up or [], "seed": seed}
    result: Result | None = None
    failure: DeviceError | None = None
    with twin.simulated(seed, hold_ups) as bench:
        script = _FaultScript(bench, faults)
        try:
            result = run_pipeline(pipeline, out, script.progress, rehearsal=rehearsal)
        except DeviceError as error:
            failure = error
        truth = bench.truth
    if result is not None:
        _print_result(pipeline, result, details)
    if pipeline.safety is not None:
        console().print(_limit_table(truth, pipeline.safety).view())
    for name, _ in script.pending:
        typer.echo(f"{name} was never made: the run ended before its time", err=True)
    if failure is not None:
        raise failure
    assert result is not None
    result.demand_whole()


def _print_result(pipeline: Pipeline, result: Result, details: bool) -> None:
    """Print the tables of a result, and its folder."""
    terminal = console(DETAILS_WIDTH if details else WIDTH)
    for view in result_views(pipeline, result, details):
        print_view(terminal, view)
    typer.echo(f"written to {result.folder}")


def _specimen_overrides(entries: Sequence[str]) -> Iterator[str]:
    """Yield the overrides twin.*.specimen.KEY=VALUE of entries KEY=VALUE; raises ConfigurationError for any other."""
    for entry in entries:
        if "=" not in entry:
            raise ConfigurationError(f'--specimen {entry!r}: expected "KEY=VALUE", such as "elasticity=100 kPa"')
        yield f"{TWIN_PREFIX}specimen.{entry}"


def load_rehearsal(file: Path, overrides: Sequence[str]) -> Pipeline:
    """Return a rig's pipeline with one twin; raises ConfigurationError where it cannot be rehearsed.

    Overrides twin.*.KEY=VALUE are those of the pipeline's twin, or of one that stands in for its devices.
    """
    pipeline_overrides = [entry for entry in overrides if not entry.startswith(TWIN_PREFIX)]
    twin_overrides = [entry.removeprefix(TWIN_PREFIX) for entry in overrides if entry.startswith(TWIN_PREFIX)]
    pipeline = load_pipeline(file, pipeline_overrides)
    if not pipeline.trajectories or not any(device.live for device in pipeline.devices.values()):
        raise ConfigurationError(f"{file}: nothing to rehearse: no live device with a [trajectory.*] table")
    if len(pipeline.twins) > 1:
        raise ConfigurationError(f"{file}: expected one [twin.*] table, not {len(pipeline.twins)}")
    if not pipeline.twins:
        if not twin_overrides:
            raise ConfigurationError(
                f"{file} has no [twin.*] table: what does the tip press on? For example "
                '--specimen "elasticity=100 kPa" --specimen "viscosity=300 Pa*s"'
            )
        pipeline_overrides += _stand_in_overrides(pipeline)
    name = next(iter(pipeline.twins), "rehearsal")
    named_overrides = [f"twin.{name}.{entry}" for entry in twin_overrides]
    return load_pipeline(file, [*pipeline_overrides, *named_overrides, f'run.rehearsal="{name}"'])


def _stand_in_overrides(pipeline: Pipeline) -> Iterator[str]:
    """Yield the overrides that add a twin to a rig without one: the first that stands in for its devices.

    Raises ConfigurationError where no twin does.
    """
    for part_name, entry in pipeline.registry.parts["twin"].items():
        if entry.problem is not None:
            continue
        part = entry.part
        assert issubclass(part, Twin)
        settings = part.stand_in(pipeline.devices, pipeline.alignment.tip_mass)
        if settings is not None:
            yield f'twin.rehearsal.type="{part_name}"'
            yield f'twin.rehearsal.specimen.model="{next(iter(pipeline.models), "")}"'
            yield from (f"twin.rehearsal.{key}={text}" for key, text in settings.items())
            return
    names = ", ".join(pipeline.devices)
    raise ConfigurationError(f"{pipeline.path}: no twin stands in for {names}; a [twin.*] table says what does")


def _parse_hold_up(text: str) -> HoldUp:
    """Return the hold-up of a text PROCESS DURATION [every PERIOD], such as "robot 8 ms every 1 s".

    Raises ConfigurationError for any other text, and for a period that is not longer than the hold-up.
    """
    option = f"--hold-up {text!r}"
    match = HOLD_UP.fullmatch(text.strip())
    if match is None:
        raise ConfigurationError(f'{option}: expected "WHO DURATION" or "WHO DURATION every PERIOD"')
    process = match["process"]
    if process not in PROCESSES:
        raise ConfigurationError(f"{option}: {process} is unknown{suggest(process, PROCESSES)}")
    duration = _parse_time(match["duration"], option)
    if match["period"] is None:
        return HoldUp(process, duration, 0.0, None)
    period = _parse_time(match["period"], option)
    if period <= duration:
        raise ConfigurationError(f"{option}: expected a period of more than the {1e3 * duration:g} ms")
    return HoldUp(process, duration, period, period)


def _parse_faults(texts: Sequence[str]) -> list[tuple[str, float]]:
    """Return faults with their numbers, and their times [s], of texts "FAULT@TIME"; the earliest first."""
    faults = []
    for text in texts:
        fault, mark, time = text.rpartition("@")
        if not mark or not fault.strip():
            raise ConfigurationError(f'--fault {text!r}: expected "NAME@TIME", such as "protective-stop@3 s"')
        faults.append((fault.strip(), _parse_time(time, f"--fault {text!r}")))
    return sorted(faults, key=lambda entry: entry[1])


def _parse_time(text: str, option: str) -> float:
    """Return the time [s] of a text such as "8 ms"; raises ConfigurationError, which begins with the option."""
    try:
        seconds = float(TIME.validate_python(text.strip()))
    except (ValidationError, ConfigurationError) as error:
        raise ConfigurationError(f"{option}: {text.strip()!r} is not a time, such as 8 ms") from error
    if not 0.0 <= seconds < math.inf:
        raise ConfigurationError(f"{option}: {text.strip()!r} is not a time that comes")
    return seconds


@dataclass
class _FaultScript:
    """Faults with their numbers that are made at their times [s] in the record, the earliest first."""

    bench: SimulatedTwin
    pending: list[tuple[str, float]]

    def __post_init__(self) -> None:
        """Raise ConfigurationError for a fault that the twin does not have, or with too few or too many numbers."""
        usages = {entry.split()[0]: entry for entry in self.bench.faults}
        for fault, _ in self.pending:
            name = fault.split()[0]
            if name not in usages:
                all_usages = ", ".join(usages.values())
                raise ConfigurationError(
                    f"--fault {name}: no such fault{suggest(name, usages)}; all of them: {all_usages}"
                )
            if len(fault.split()) != len(usages[name].split()):
                raise ConfigurationError(f'--fault {fault!r}: expected "{usages[name]}@TIME"')

    def progress(self, reached: float, total: float | None, behind: float) -> None:
        """Make the faults that are due at a time [s] of the record, `reached`."""
        while self.pending and reached >= self.pending[0][1]:
            fault, _ = self.pending.pop(0)
            try:
                self.bench.fault(fault)
            except ConfigurationError as error:
                raise ConfigurationError(f"--fault {fault!r}: {error}") from error


def _limit_table(truth: ArmTruth, limits: SafetySettings) -> Table:
    """Return a table of what the arm truly did against each limit: reached, allowed, and left to the limit."""

    def row(name: str, unit: str, scale: float, reached: float, limit: float, sign: int = -1) -> tuple[str, ...]:
        """Return a row in a unit that is 1/scale of SI; a limit is an upper one, or a lower one with a sign of 1."""
        numbers = (reached, limit, sign * (reached - limit))
        return name, *(f"{scale * number:z.2f} {unit}" for number in numbers)

    mm, degree = 1e3, math.degrees(1.0)
    rows = []
    for i, axis in enumerate("xyz"):
        rows.append(row(f"{axis}, low", "mm", mm, truth.low[i], limits.low[i], sign=1))
        rows.append(row(f"{axis}, high", "mm", mm, truth.high[i], limits.high[i]))
    rows.append(row("speed", "mm/s", mm, truth.speed, limits.retract_speed or limits.speed))
    rows.append(row("turn of the tool", "deg/s", degree, truth.turning, limits.angular_speed))
    rows.append(row("force on the skin", "N", 1.0, truth.force, limits.force))
    # [safety] limits the acceleration of the motion; a stop brakes as hard as the robot can.
    rows.append(("acceleration", f"{truth.acceleration:.2f} m/s^2", f"{limits.acceleration:.2f} m/s^2 in motion", ""))
    title = "What the arm did" + ("; it still moves" if truth.moving else "")
    return Table.of(title, ("limit", "reached", "allowed", "left"), rows, ("limit",))
