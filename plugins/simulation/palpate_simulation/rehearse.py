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

_ACTORS = ("robot", "sensor", "main")
_HOLD_UP = re.compile(r"(?P<who>\w+)\s+(?P<duration>[\d.]+\s*\w+)(\s+every\s+(?P<every>[\d.]+\s*\w+))?")
_TIME = TypeAdapter(Time)


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
    pipeline = _rehearsed(file, [*(overrides or []), *_of_specimen(specimen or [])])
    (twin,) = pipeline.twins.values()
    hold_ups, faults = [_hold_up(text) for text in hold_up or []], _faults(fault or [])
    rehearsal = {"faults": fault or [], "hold_ups": hold_up or [], "seed": seed}
    result: Result | None = None
    failure: DeviceError | None = None
    with twin.simulated(seed, hold_ups) as bench:
        script = _Script(bench, faults)
        try:
            result = run_pipeline(pipeline, out, script.progress, rehearsal=rehearsal)
        except DeviceError as error:
            failure = error
        truth = bench.truth
    if result is not None:
        terminal = console(120 if details else WIDTH)
        for view in result_views(pipeline, result, details):
            print_view(terminal, view)
        typer.echo(f"written to {result.folder}")
    if pipeline.safety is not None:
        console().print(_limits(truth, pipeline.safety).view())
    for words, _ in script.waiting:
        typer.echo(f"{words} was never made: the run ended before its time", err=True)
    if failure is not None:
        raise failure
    assert result is not None
    result.demand_whole()


def _of_specimen(entries: Sequence[str]) -> Iterator[str]:
    """Settings of the specimen of whatever twin there is; raises ConfigurationError."""
    for entry in entries:
        if "=" not in entry:
            raise ConfigurationError(f'--specimen {entry!r}: expected "KEY=VALUE", such as "elasticity=100 kPa"')
        yield f"twin.*.specimen.{entry}"


def _rehearsed(file: Path, overrides: Sequence[str]) -> Pipeline:
    """Return a pipeline that can be rehearsed; raises ConfigurationError."""
    stated = [entry for entry in overrides if not entry.startswith("twin.*")]
    rest = [entry.removeprefix("twin.*.") for entry in overrides if entry.startswith("twin.*")]
    pipeline = load_pipeline(file, stated)
    if not pipeline.trajectories or not any(device.live for device in pipeline.devices.values()):
        raise ConfigurationError(f"{file}: nothing to rehearse: no live device with a [trajectory.*] table")
    if len(pipeline.twins) > 1:
        raise ConfigurationError(f"{file}: expected one [twin.*] table, not {len(pipeline.twins)}")
    if not pipeline.twins:
        if not rest:
            raise ConfigurationError(
                f"{file} has no [twin.*] table: what does the tip press on? For example "
                '--specimen "elasticity=100 kPa" --specimen "viscosity=300 Pa*s"'
            )
        stated += _stand_in(pipeline)
    name = next(iter(pipeline.twins), "rehearsal")
    return load_pipeline(file, [*stated, *(f"twin.{name}.{entry}" for entry in rest), f'run.rehearsal="{name}"'])


def _stand_in(pipeline: Pipeline) -> Iterator[str]:
    """Settings of a twin for a rig that has none; raises ConfigurationError where no twin is made for it."""
    for kind, entry in pipeline.registry.parts["twin"].items():
        if entry.problem is not None:
            continue
        part = entry.part
        assert issubclass(part, Twin)
        settings = part.stand_in(pipeline.devices, pipeline.alignment.tip_mass)
        if settings is not None:
            yield f'twin.rehearsal.type="{kind}"'
            yield f'twin.rehearsal.specimen.model="{next(iter(pipeline.models), "")}"'
            yield from (f"twin.rehearsal.{key}={value}" for key, value in settings.items())
            return
    names = ", ".join(pipeline.devices)
    raise ConfigurationError(f"{pipeline.path}: no twin stands in for {names}; a [twin.*] table says what does")


def _hold_up(text: str) -> HoldUp:
    match = _HOLD_UP.fullmatch(text.strip())
    if match is None:
        raise ConfigurationError(f'--hold-up {text!r}: expected "WHO DURATION" or "WHO DURATION every PERIOD"')
    if match["who"] not in _ACTORS:
        raise ConfigurationError(f"--hold-up {text!r}: {match['who']} is unknown{suggest(match['who'], _ACTORS)}")
    duration = _seconds(match["duration"], f"--hold-up {text!r}")
    every = None if match["every"] is None else _seconds(match["every"], f"--hold-up {text!r}")
    if every is not None and every <= duration:
        raise ConfigurationError(f"--hold-up {text!r}: expected a period of more than the {1e3 * duration:g} ms")
    return HoldUp(match["who"], duration, 0.0 if every is None else every, every)


def _faults(texts: Sequence[str]) -> list[tuple[str, float]]:
    """Faults and their times [s], the earliest first."""
    faults = []
    for text in texts:
        words, mark, time = text.rpartition("@")
        if not mark or not words.strip():
            raise ConfigurationError(f'--fault {text!r}: expected "NAME@TIME", such as "protective-stop@3 s"')
        faults.append((words.strip(), _seconds(time, f"--fault {text!r}")))
    return sorted(faults, key=lambda entry: entry[1])


def _seconds(text: str, where: str) -> float:
    try:
        seconds = float(_TIME.validate_python(text.strip()))
    except (ValidationError, ConfigurationError) as error:
        raise ConfigurationError(f"{where}: {text.strip()!r} is not a time, such as 8 ms") from error
    if not 0.0 <= seconds < math.inf:
        raise ConfigurationError(f"{where}: {text.strip()!r} is not a time that comes")
    return seconds


@dataclass
class _Script:
    """Faults that wait for their times in the record."""

    bench: SimulatedTwin
    waiting: list[tuple[str, float]]

    def __post_init__(self) -> None:
        known = {entry.split()[0]: entry for entry in self.bench.faults}
        for words, _ in self.waiting:
            name = words.split()[0]
            if name not in known:
                all_of_them = ", ".join(known.values())
                raise ConfigurationError(
                    f"--fault {name}: no such fault{suggest(name, known)}; all of them: {all_of_them}"
                )
            if len(words.split()) != len(known[name].split()):
                raise ConfigurationError(f'--fault {words!r}: expected "{known[name]}@TIME"')

    def progress(self, reached: float, total: float | None, behind: float) -> None:
        """Make the faults that are due."""
        while self.waiting and reached >= self.waiting[0][1]:
            words, _ = self.waiting.pop(0)
            try:
                self.bench.fault(words)
            except ConfigurationError as error:
                raise ConfigurationError(f"--fault {words!r}: {error}") from error


def _limits(truth: ArmTruth, limits: SafetySettings) -> Table:
    """What the arm truly did against each limit."""
    mm, degrees, speed = 1e3, math.degrees(1.0), limits.retract_speed or limits.speed
    ranges = [
        *(
            (f"{axis}, {side}", "mm", mm, reached[i], limit[i], sign * (reached[i] - limit[i]))
            for i, axis in enumerate("xyz")
            for side, reached, limit, sign in (("low", truth.low, limits.low, 1), ("high", truth.high, limits.high, -1))
        ),
        ("speed", "mm/s", mm, truth.speed, speed, speed - truth.speed),
        (
            "turn of the tool",
            "deg/s",
            degrees,
            truth.turning,
            limits.angular_speed,
            limits.angular_speed - truth.turning,
        ),
        ("force on the skin", "N", 1.0, truth.force, limits.force, limits.force - truth.force),
    ]
    rows = [(what, *(f"{scale * value:z.2f} {unit}" for value in values)) for what, unit, scale, *values in ranges]
    # [safety] limits the acceleration of the motion; a stop brakes as hard as the robot can.
    rows.append(("acceleration", f"{truth.acceleration:.2f} m/s^2", f"{limits.acceleration:.2f} m/s^2 in motion", ""))
    title = "What the arm did" + ("; it still moves" if truth.moving else "")
    return Table.of(title, ("limit", "reached", "allowed", "left"), rows, ("limit",))
