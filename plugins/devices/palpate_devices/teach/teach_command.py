"""``palpate calibrate teach``: a person leads the arm, this program finds where the specimen and the tip are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from palpate import ConfigurationError, Length, suggest
from palpate_engine import Pipeline, load_pipeline, refuse_rehearsal
from palpate_kit.terminal.json_output import print_aside, print_json
from palpate_kit.terminal.options import JsonOption, Overrides
from pydantic import TypeAdapter, ValidationError

from palpate_devices.teach.flange_load import weigh_flange
from palpate_devices.teach.pipeline_edit import edited_text, write_pipeline
from palpate_devices.teach.surface_plane import SurfacePlane, check_fourth, work_frame
from palpate_devices.teach.tip_pivot import check_tip, pivot_of

if TYPE_CHECKING:
    from palpate_arms.arm_by_hand import HandReader, Posture
    from palpate_arms.arm_device import ArmDevice

_LENGTH = TypeAdapter(Length)
_LOAD_PROMPTS = ("tool down", "tool level", "tool level, turned about its own axis by 90 deg", "tool half way down")
_TURN_PROMPTS = ("straight", "10 deg forwards", "10 deg backwards", "10 deg to the left", "10 deg to the right")
_POINT_PROMPTS = (
    "the first point of the surface",
    "a second one, some centimetres away",
    "a third one, to the side of both",
    "the fourth, where the specimen is palpated: it becomes the origin",
)
_STEP_TEXTS = {
    "payload": "what hangs at the flange is weighed",
    "tip": "the tip is checked by turning the tool about it",
    "surface": "the surface is touched",
}
_MAX_TOOL_ANGLE = math.radians(5.0)  # from the normal; over it a run refuses to begin by default ([safety] orientation)
_MAX_TOLERANCE = 0.01  # [m], a choice: a skin that departs farther from a plane is refused
_MM = _GRAMS = 1e3  # per metre, per kilogram


def teach(
    file: Annotated[Path, typer.Argument(help="The pipeline file of the rig.")],
    overrides: Overrides = None,
    step: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Only payload, tip or surface; can be repeated.")
    ] = None,
    tolerance: Annotated[
        str, typer.Option(metavar="LENGTH", help="How far the fourth point may be from the plane of the others.")
    ] = "0.5 mm",
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Write a new pipeline file. [default: FILE; the former is kept]")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Find payload, tip and surface by leading the arm in freedrive; write them into the pipeline. Nothing is moved.

    The payload is weighed in four orientations; the tool is turned by 10 deg about its tip, which stands in a small
    hole; the tip touches three points of the surface, and a fourth that has to lie on their plane. Exit code 2, and
    nothing written, where something contradicts.
    """
    pipeline = load_pipeline(file, overrides or [])
    refuse_rehearsal(pipeline)
    name, arm = _robot(pipeline)
    steps, allowed = _steps(step or [], name, arm), _length(tolerance)
    if out is not None and out.exists():
        raise ConfigurationError(f"{out}: exists already; nothing is ever overwritten")
    # A person leads the arm; whatever contradicts is raised before anything is written.
    with arm.by_hand("payload" in steps) as reader:
        findings, changes = _findings(reader, steps, _ball(pipeline), allowed)
    # The file as it is now has to load.
    with print_aside(as_json):
        if changes:
            former = write_pipeline(file, edited_text(pipeline.text, name, changes), out)
            _say(f"written to {out or file}" + (f"; the former one is {former}" if former else ""))
            load_pipeline(out or file, overrides or [])
    if as_json:
        print_json({"file": str(out or file), "device": name, **findings})


def _findings(
    reader: HandReader, steps: Sequence[str], radius: float, tolerance: float
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return what the steps find, and what of it is written into the pipeline: payload and work frame."""
    findings: dict[str, Any] = {}
    changes: dict[str, Any] = {}
    if "payload" in steps:
        payload = _payload(_read(reader, "payload", _LOAD_PROMPTS))
        findings |= payload
        changes |= payload
    if "tip" in steps:
        findings |= _tip(_read(reader, "tip", _TURN_PROMPTS), reader, radius)
    if "surface" in steps:
        surface, work = _surface(_read(reader, "surface", _POINT_PROMPTS), tolerance)
        findings |= {**surface, "work": work}
        changes |= {"work": work}
    return findings, changes


def _payload(postures: Sequence[Posture]) -> dict[str, Any]:
    """Return the payload and its centre as settings, weighed in some postures, and print them."""
    load = weigh_flange(postures)
    centre = ", ".join(f"{_MM * x:z.0f}" for x in load.centre)
    _say(
        f"payload: {_GRAMS * load.mass:.0f} g +- {_GRAMS * load.mass_std:.0f} g, its centre at ({centre}) mm +- "
        f"{_MM * load.centre_std:.0f} mm on the flange; set the pendant's to that as well: freedrive depends on it"
    )
    return {
        "payload": f"{_GRAMS * load.mass:.0f} g",
        "payload_centre": [f"{_MM * x:z.0f} mm" for x in load.centre.tolist()],
    }


def _tip(postures: Sequence[Posture], reader: HandReader, radius: float) -> dict[str, Any]:
    """Return the tip's distance from where the pipeline has it, and its uncertainty [m], and print them."""
    pivot = pivot_of([posture.flange for posture in postures])
    distance = check_tip(pivot, reader.tool, radius)
    _say(
        f"tip: {_MM * distance:.2f} mm from where tcp has it, known to {_MM * pivot.std:.2f} mm; it slid by "
        f"{_MM * pivot.residual:.2f} mm"
    )
    return {"tip_off": distance, "tip_std": pivot.std}


def _surface(postures: Sequence[Posture], tolerance: float) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the checks of a touched surface, and its work frame as settings; print the checks.

    The last of the four postures is the origin; its point may be the tolerance [m] off the plane of the other three.
    """
    import numpy as np

    points = np.array([posture.tip[:3, 3] for posture in postures])
    tool_rotation = postures[-1].tip[:3, :3]
    plane = SurfacePlane.through(points[:3], -tool_rotation[:, 2])
    distance = check_fourth(plane, points[:3], points[3], tolerance)
    frame, tool_angle = work_frame(plane, points[3], tool_rotation)
    _say(
        f"surface: the fourth point is {_MM * distance:+.2f} mm off the plane; the tool "
        f"{math.degrees(tool_angle):.1f} deg off its normal"
    )
    if tool_angle > _MAX_TOOL_ANGLE:
        limit = f"{math.degrees(_MAX_TOOL_ANGLE):g} deg"
        _say(f"  turn the tool nearer to the normal before a run: [safety] orientation is {limit} unless it is stated")
    # 10 um and 0.001 deg, finer than any arm repeats; z prints a rounded -0 as 0.
    work = {
        "origin": [f"{_MM * x:z.2f} mm" for x in frame.origin],
        "rotation": [f"{math.degrees(x):z.3f} deg" for x in frame.rotation],
        "turn": f"{math.degrees(frame.turn):z.2f} deg",
    }
    return {"fourth_point": distance, "tool_off": tool_angle}, work


def _read(reader: HandReader, step: str, places: Sequence[str]) -> list[Posture]:
    """Return one posture after the other, each read once a person says that it is there, and again while unsteady."""
    from palpate_arms.arm_by_hand import UnsteadyError

    _say(f"{step}: {_STEP_TEXTS[step]}")
    postures = []
    for number, place in enumerate(places, 1):
        text = f"  {number} of {len(places)}: {place}; let go of freedrive, then press Enter"
        while True:
            _ask(text)
            try:
                postures.append(reader.read())
            except UnsteadyError as error:
                text = f"  once more, {error}; then press Enter"
            else:
                break
    return postures


def _ask(text: str) -> None:
    """Wait for a person to press Enter; raises ConfigurationError where none is there."""
    try:
        typer.prompt(text, default="", show_default=False, prompt_suffix=" ", err=True)
    except (EOFError, typer.Abort) as error:
        raise ConfigurationError("no answer: a person has to lead the arm; nothing was written") from error


def _say(text: str) -> None:
    """Print a line for the person at the arm."""
    typer.echo(text, err=True)


def _robot(pipeline: Pipeline) -> tuple[str, ArmDevice]:
    """Return the one robot of a pipeline, with its name; raises ConfigurationError."""
    from palpate_arms.arm_device import ArmDevice

    robots = {name: device for name, device in pipeline.devices.items() if isinstance(device, ArmDevice)}
    if len(robots) != 1:
        names = ", ".join(robots) or "none"
        raise ConfigurationError(f"{pipeline.path}: expected one robot, not {len(robots)} ({names})")
    return next(iter(robots.items()))


def _ball(pipeline: Pipeline) -> float:
    """Return the radius [m] of the tip where it is a ball, about whose centre it turns in a hole; 0 of any other."""
    tips = list(pipeline.indenters.values())
    return (tips[0].sphere_radius or 0.0) if len(tips) == 1 else 0.0


def _steps(names: Sequence[str], device: str, arm: ArmDevice) -> tuple[str, ...]:
    """Return the steps by name, or all that this arm can do; raises ConfigurationError."""
    for name in names:
        if name not in _STEP_TEXTS:
            raise ConfigurationError(f"--step {name}: no such step{suggest(name, _STEP_TEXTS)}")
    if "payload" in names and not arm.weighs_flange:
        raise ConfigurationError(f"--step payload: [device.{device}] has no sensor in its flange that could weigh it")
    if names:
        return tuple(name for name in _STEP_TEXTS if name in names)
    return tuple(name for name in _STEP_TEXTS if name != "payload" or arm.weighs_flange)


def _length(text: str) -> float:
    """Return the tolerance [m]; raises ConfigurationError where it is not a length, or none that makes sense."""
    try:
        length = float(_LENGTH.validate_python(text.strip()))
    except (ValidationError, ConfigurationError) as error:
        raise ConfigurationError(f"--tolerance {text!r}: is not a length, such as 0.5 mm") from error
    if not 0.0 < length <= _MAX_TOLERANCE:
        raise ConfigurationError(f"--tolerance {text!r}: from above 0 up to 10 mm is allowed")
    return length
