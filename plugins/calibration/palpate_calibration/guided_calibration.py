"""Run a calibration step by step, from the first batch to the values."""

from __future__ import annotations

import importlib.metadata
import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from typing import Any

import numpy as np
from palpate import ConfigurationError, KnowsGravity, LogError, duration_of
from palpate_engine import Reach, is_live, mounting_of, plain_settings
from palpate_kit.runs.calibration_file import Calibration

from palpate_calibration.calibrated_value import calibrated_value
from palpate_calibration.calibration_record import CalibrationRecord
from palpate_calibration.calibration_use import identity_of
from palpate_calibration.mounting import Mounting, find_mounting
from palpate_calibration.orientations import Pose, tools_of, weigh_tool
from palpate_calibration.plan import CalibrationPlan
from palpate_calibration.protocol import StepFindings, calibrate, join_steps
from palpate_calibration.record_acquisition import (
    Seen,
    moves,
    one_pose,
    poses_of_a_log,
    reach_of,
    record,
    with_step,
    words,
)
from palpate_calibration.settings import ON_A_PLATE, STEPS, Orientations, StepSettings
from palpate_calibration.standstill import noise_spectrum
from palpate_calibration.steps import evaluate_step

_MORE = 2  # attempts at a step's repeats on a live rig


def _silent(text: str) -> None:
    pass


@dataclass(frozen=True)
class Guide:
    """Who leads a person through a calibration."""

    say: Callable[[str], None] = _silent
    ask: Callable[[str], None] = _silent  # returns when it is done
    found: Callable[[str, StepFindings], None] = lambda step, session: None
    keep: Callable[[Calibration], None] = lambda calibration: None  # what the steps until now come to


def run_calibration(
    plan: CalibrationPlan, guide: Guide | None = None
) -> tuple[Calibration, StepFindings, list[CalibrationRecord]]:
    """Move and record as often as the plan states, and evaluate; the records are those of the shake.

    Raises ConfigurationError where a motion breaks a limit, before anything moves; LogError where a record cannot be
    used; DeviceError where a device fails.
    """
    guide, seen = guide or Guide(), Seen()
    steps = plan.settings.steps
    if not steps:
        one = _unguided(plan, guide, seen)
        guide.say("evaluating")
        session = calibrate(one, plan.settings)
        return _calibration(plan, session, seen), session, one
    reaches = {name: _reach(plan, name, step) for name, step in steps.items()}
    sessions: dict[str, StepFindings] = {}
    records: list[CalibrationRecord] = []
    for number, (name, step) in enumerate(steps.items(), 1):
        guide.say(f"step {number} of {len(steps)}, {name}: {STEPS[name]}")
        if (reach := reaches[name]) is not None:
            guide.say(f"  {words(reach, plan.settings)}")
        if isinstance(step, Orientations):
            session = _oriented(plan, step, guide)
        else:
            done = _records(plan, name, step, number, guide, seen)
            session = evaluate_step(name, done, plan.settings)
            records = done if name == "shake" else records
        guide.found(name, session)
        sessions[name] = session
        guide.keep(_calibration(plan, _joined(plan, sessions), seen))
    session = _joined(plan, sessions)
    return _calibration(plan, session, seen), session, records


def _joined(plan: CalibrationPlan, sessions: Mapping[str, StepFindings]) -> StepFindings:
    # A slow motion shows the noise of the velocity better than a fast one.
    ordered = sorted(sessions, key=lambda name: name == "shake" and "noise" in sessions)
    return join_steps([sessions[name] for name in ordered], plan.settings)


def _unguided(plan: CalibrationPlan, guide: Guide, seen: Seen) -> list[CalibrationRecord]:
    """Standstill, shake, standstill, as one motion."""
    if not moves(plan):
        guide.say("reading the log")
        return [record(plan)]
    if plan.settings.trajectory is None and len(plan.trajectories) != 1:
        raise ConfigurationError(
            f'{plan.path}: a calibration needs one motion: [calibration] trajectory = {{ type = "shake" }}'
        )
    step = StepSettings(trajectory=plan.settings.trajectory or next(iter(plan.trajectories.values())))
    contact = plan.settings.motion == "plate"
    reach = reach_of(with_step(plan, step), contact)
    guide.say(f"{words(reach, plan.settings)}")
    name = "shake" if plan.settings.motion == "shake" else "press"
    return _repeated(with_step(plan, step), name, plan.settings.repeats, 0, guide, seen)


def _reach(plan: CalibrationPlan, name: str, step: StepSettings | Orientations) -> Reach | None:
    """Return how far, fast and sudden a step's motion is; None where it reads a log or nothing moves."""
    of_step = with_step(plan, step)
    if not moves(of_step):
        return None
    if isinstance(step, Orientations) and is_live(of_step.devices):
        return None  # a person turns the tool, and the arm is not even connected
    if step.trajectory is None:
        raise ConfigurationError(
            f"{plan.path}: [calibration.{name}] needs a motion, such as "
            f'trajectory = {{ type = "{"shake" if name in ("shake", "noise") else "stay"}" }}'
        )
    return reach_of(of_step, name in ON_A_PLATE, f"[calibration.{name}] ")


def _records(
    plan: CalibrationPlan, name: str, step: StepSettings, number: int, guide: Guide, seen: Seen
) -> list[CalibrationRecord]:
    of_step = with_step(plan, step)
    if not moves(of_step):
        guide.say("  reading the log")
        return [record(of_step)]
    if is_live(of_step.devices):
        where = "lay a stiff plate under the tip" if name in ON_A_PLATE else "see that the tip hangs free"
        guide.ask(f"  {where}, keep clear of the robot")
    return _repeated(of_step, name, step.repeats or plan.settings.repeats, 1000 * number, guide, seen)


def _repeated(
    plan: CalibrationPlan, name: str, repeats: int, seed: int, guide: Guide, seen: Seen
) -> list[CalibrationRecord]:
    """So many records that can be used; a live rig, where things happen, gets some more attempts than repeats."""
    done: list[CalibrationRecord] = []
    live = is_live(plan.devices)
    length = sum(map(duration_of, plan.trajectories.values()))
    refused = 0
    while len(done) < repeats:
        guide.say(f"  repeat {len(done) + 1} of {repeats}: {length:.0f} s of motion")
        found = record(plan, seed + len(done) + refused, seen)
        try:
            evaluate_step(name, [found], plan.settings)
        except LogError as error:
            refused += 1
            if not live or refused > _MORE:
                raise
            guide.say(f"  not usable, once more: {error}")
        else:
            done.append(found)
    return done


def _oriented(plan: CalibrationPlan, step: Orientations, guide: Guide) -> StepFindings:
    """Return the step in which the tool is turned: by a simulated rig, by a person, or in a log."""
    of_step = with_step(plan, step)
    if not moves(of_step) and not is_live(of_step.devices):
        guide.say("  reading the log")
        repeats = [poses_of_a_log(of_step, len(step.down))]
    else:
        repeats = []
        for repeat in range(step.repeats or plan.settings.repeats):
            poses = []
            for number, down in enumerate(step.down):
                along = ", ".join(f"{part:.3f}" for part in down)
                text = f"  orientation {number + 1} of {len(step.down)}: gravity along ({along}) in the sensor's frame"
                poses.append(one_pose(of_step, step, down, 100 * repeat + number, partial(guide.ask, text)))
            repeats.append(poses)
    try:
        mounting = _mounting(of_step, step, repeats)
    except LogError as error:
        values = weigh_tool(repeats, step.down, step.angle_std)
        reason = str(error).removeprefix("calibration: ")
        return StepFindings(values, notes=(f"no mounting of the sensor on the tool: {reason}",))
    if mounting is None:
        return StepFindings(weigh_tool(repeats, step.down, step.angle_std))
    directions = np.array(step.down) if "down" in step.model_fields_set else mounting.down
    values = weigh_tool(repeats, directions, step.angle_std) | mounting.values
    return StepFindings(values, notes=() if mounting.note is None else (mounting.note,))


def _mounting(plan: CalibrationPlan, step: Orientations, repeats: Sequence[Sequence[Pose]]) -> Mounting | None:
    """Return the sensor's mounting, where the arm's poses are recorded; raises LogError where they do not determine
    it."""
    tools = tools_of(repeats)
    if tools is None:
        return None
    signal, arm, force = plan.alignment.force, plan.devices[plan.ports["position"].device], plan.ports["force"]
    stated = plan.alignment.gravity or (arm.gravity if isinstance(arm, KnowsGravity) else (0.0, 0.0, -1.0))
    near = mounting_of(plan.alignment, force.components.index(force.column)) or (0.0, 0.0, 0.0)
    return find_mounting(tools, np.array(stated) / np.linalg.norm(stated), step.angle_std, signal.sign, near)


def _shake(session: StepFindings) -> dict[str, Any]:
    if not session.shakes:
        return {}
    first = session.shakes[0]
    return {
        "frequencies": list(first.frequencies),
        "amplitudes": list(first.amplitudes),
        "residual": session.residual,
        "count": len(session.shakes),
    }


def _logs(plan: CalibrationPlan) -> dict[str, dict[str, str]]:
    """What the devices of single steps report of themselves: of a log, file and hash."""
    return {
        f"{name}.{device}": dict(part.provenance)
        for name, step in plan.settings.steps.items()
        for device, part in step.device.items()
        if "sha256" in part.provenance
    }


def _calibration(plan: CalibrationPlan, session: StepFindings, seen: Seen) -> Calibration:
    roles = ("force", "position", "velocity")
    channels = {role: s.channel for role in roles if (s := getattr(plan.alignment, role)) is not None}
    every = dict(plan.devices)
    for step in plan.settings.steps.values():
        every = dict(step.device) | every
    devices = identity_of(every, channels)
    for name in devices:
        devices[name] |= seen.get(name, {})
        devices[name]["type"] = plan.registry.name_of(type(every[name]))
    tip: dict[str, Any] | None = None
    if len(plan.indenters) == 1:
        tip = plain_settings(next(iter(plan.indenters.values())), plan.registry)
    return Calibration(
        name=plan.run.name,
        created=datetime.now(UTC).replace(microsecond=0),
        values={name: calibrated_value(measured) for name, measured in session.values.items()},
        channels=channels,
        devices=devices,
        tip=tip,
        shake=_shake(session),
        spectra={role: noise_spectrum(spectrum) for role, spectrum in session.spectra.items()},
        logs=_logs(plan),
        notes=session.notes,
        versions={"palpate": importlib.metadata.version("palpate"), "python": platform.python_version()},
    )
