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
    DeviceFacts,
    moves,
    one_pose,
    poses_of_a_log,
    reach_of,
    reach_text,
    record,
    with_step,
)
from palpate_calibration.settings import ON_A_PLATE, STEPS, Orientations, StepSettings
from palpate_calibration.standstill import noise_spectrum
from palpate_calibration.steps import evaluate_step

_MAX_REFUSALS = 2  # records of a step on a live rig that may be unusable: a choice
_STEP_SEEDS, _REPEAT_SEEDS = 1000, 100  # seeds between steps, and between repeats of orientations


def _silent(text: str) -> None:
    pass


@dataclass(frozen=True)
class Guide:
    """Words to the person at the rig, and what becomes of the results of each step."""

    say: Callable[[str], None] = _silent
    ask: Callable[[str], None] = _silent  # returns once the person has done it
    show: Callable[[str, StepFindings], None] = lambda step, findings: None  # the results of a step
    keep: Callable[[Calibration], None] = lambda calibration: None  # the calibration by the steps so far


def run_calibration(
    plan: CalibrationPlan, guide: Guide | None = None
) -> tuple[Calibration, StepFindings, list[CalibrationRecord]]:
    """Move and record as often as the plan states, and evaluate; the records are those of the shake.

    `guide` shows a person what is done, and keeps the results after each step. Raises ConfigurationError where a motion
    breaks a limit, before anything moves; LogError where a record cannot be used; DeviceError where a device fails.
    """
    guide, facts = guide or Guide(), DeviceFacts()
    steps = plan.settings.steps
    if not steps:
        records = _unguided_records(plan, guide, facts)
        guide.say("evaluating")
        findings = calibrate(records, plan.settings)
        return _calibration(plan, findings, facts), findings, records
    reaches = {name: _reach(plan, name, step) for name, step in steps.items()}
    findings_by_step: dict[str, StepFindings] = {}
    shake_records: list[CalibrationRecord] = []
    for number, (name, step) in enumerate(steps.items(), 1):
        guide.say(f"step {number} of {len(steps)}, {name}: {STEPS[name]}")
        if (reach := reaches[name]) is not None:
            guide.say(f"  {reach_text(reach, plan.settings)}")
        if isinstance(step, Orientations):
            findings = _weigh(plan, step, guide)
        else:
            records = _step_records(plan, name, step, number, guide, facts)
            findings = evaluate_step(name, records, plan.settings)
            shake_records = records if name == "shake" else shake_records
        guide.show(name, findings)
        findings_by_step[name] = findings
        guide.keep(_calibration(plan, _join(plan, findings_by_step), facts))
    findings = _join(plan, findings_by_step)
    return _calibration(plan, findings, facts), findings, shake_records


def _join(plan: CalibrationPlan, findings_by_step: Mapping[str, StepFindings]) -> StepFindings:
    # A slow motion shows the noise of the velocity better than a fast one.
    ordered = sorted(findings_by_step, key=lambda name: name == "shake" and "noise" in findings_by_step)
    return join_steps([findings_by_step[name] for name in ordered], plan.settings)


def _unguided_records(plan: CalibrationPlan, guide: Guide, facts: DeviceFacts) -> list[CalibrationRecord]:
    """Return the records of standstill, shake and standstill as one motion, or of the log.

    `plan` has the devices, the motions and the settings of the calibration.
    """
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
    guide.say(f"{reach_text(reach, plan.settings)}")
    name = "shake" if plan.settings.motion == "shake" else "press"
    return _usable_records(with_step(plan, step), name, plan.settings.repeats, 0, guide, facts)


def _reach(plan: CalibrationPlan, name: str, step: StepSettings | Orientations) -> Reach | None:
    """Return how far, fast and sudden a step's motion is; None where it reads a log or nothing moves."""
    step_plan = with_step(plan, step)
    if not moves(step_plan):
        return None
    if isinstance(step, Orientations) and is_live(step_plan.devices):
        return None  # a person turns the tool, and the arm is not even connected
    if step.trajectory is None:
        raise ConfigurationError(
            f"{plan.path}: [calibration.{name}] needs a motion, such as "
            f'trajectory = {{ type = "{"shake" if name in ("shake", "noise") else "stay"}" }}'
        )
    return reach_of(step_plan, name in ON_A_PLATE, f"[calibration.{name}] ")


def _step_records(
    plan: CalibrationPlan, name: str, step: StepSettings, number: int, guide: Guide, facts: DeviceFacts
) -> list[CalibrationRecord]:
    step_plan = with_step(plan, step)
    if not moves(step_plan):
        guide.say("  reading the log")
        return [record(step_plan)]
    if is_live(step_plan.devices):
        task = "lay a stiff plate under the tip" if name in ON_A_PLATE else "see that the tip hangs free"
        guide.ask(f"  {task}, keep clear of the robot")
    return _usable_records(step_plan, name, step.repeats or plan.settings.repeats, _STEP_SEEDS * number, guide, facts)


def _usable_records(
    plan: CalibrationPlan, name: str, repeats: int, seed: int, guide: Guide, facts: DeviceFacts
) -> list[CalibrationRecord]:
    """Return so many records that can be used; on a live rig some others may be unusable. Raises LogError.

    `seed` is that of a simulated rig's noise in the first record.
    """
    records: list[CalibrationRecord] = []
    live = is_live(plan.devices)
    length = sum(map(duration_of, plan.trajectories.values()))
    refused = 0
    while len(records) < repeats:
        guide.say(f"  repeat {len(records) + 1} of {repeats}: {length:.0f} s of motion")
        candidate = record(plan, seed + len(records) + refused, facts)
        try:
            evaluate_step(name, [candidate], plan.settings)
        except LogError as error:
            refused += 1
            if not live or refused > _MAX_REFUSALS:
                raise
            guide.say(f"  not usable, once more: {error}")
        else:
            records.append(candidate)
    return records


def _weigh(plan: CalibrationPlan, step: Orientations, guide: Guide) -> StepFindings:
    """Return the results of the step in which the tool is turned: by a simulated rig, by a person, or in a log.

    They are mass, centre of mass and biases, and the sensor's mounting on the tool where the arm's poses determine it.
    """
    step_plan = with_step(plan, step)
    repeats = _record_poses(step_plan, step, guide)
    try:
        mounting = _mounting(step_plan, step, repeats)
    except LogError as error:
        values = weigh_tool(repeats, step.down, step.angle_std)
        reason = str(error).removeprefix("calibration: ")
        return StepFindings(values, notes=(f"no mounting of the sensor on the tool: {reason}",))
    if mounting is None:
        return StepFindings(weigh_tool(repeats, step.down, step.angle_std))
    # Stated directions of gravity come before those of the arm's poses.
    directions = np.array(step.down) if "down" in step.model_fields_set else mounting.down
    values = weigh_tool(repeats, directions, step.angle_std) | mounting.values
    return StepFindings(values, notes=() if mounting.note is None else (mounting.note,))


def _record_poses(step_plan: CalibrationPlan, step: Orientations, guide: Guide) -> list[list[Pose]]:
    """Return the poses of each repeat, one for each orientation, from a log or after a person was asked for each."""
    if not moves(step_plan) and not is_live(step_plan.devices):
        guide.say("  reading the log")
        return [poses_of_a_log(step_plan, len(step.down))]
    repeats = []
    for repeat in range(step.repeats or step_plan.settings.repeats):
        # A person turns the tool until gravity has each direction in turn; a simulated rig has a seed for each.
        poses = []
        for number, down in enumerate(step.down):
            direction = ", ".join(f"{part:.3f}" for part in down)
            place = f"orientation {number + 1} of {len(step.down)}"
            text = f"  {place}: gravity along ({direction}) in the sensor's frame"
            seed = _REPEAT_SEEDS * repeat + number
            poses.append(one_pose(step_plan, step, down, seed, partial(guide.ask, text)))
        repeats.append(poses)
    return repeats


def _mounting(plan: CalibrationPlan, step: Orientations, repeats: Sequence[Sequence[Pose]]) -> Mounting | None:
    """Return the sensor's mounting; None without recorded poses of the arm.

    Raises LogError where the poses do not determine it.
    """
    tools = tools_of(repeats)
    if tools is None:
        return None
    signal, arm, force = plan.alignment.force, plan.devices[plan.ports["position"].device], plan.ports["force"]
    gravity = plan.alignment.gravity or (arm.gravity if isinstance(arm, KnowsGravity) else (0.0, 0.0, -1.0))
    nominal = mounting_of(plan.alignment, force.components.index(force.column)) or (0.0, 0.0, 0.0)
    return find_mounting(tools, np.array(gravity) / np.linalg.norm(gravity), step.angle_std, signal.sign, nominal)


def _shake(findings: StepFindings) -> dict[str, Any]:
    if not findings.shakes:
        return {}
    first = findings.shakes[0]
    return {
        "frequencies": list(first.frequencies),
        "amplitudes": list(first.amplitudes),
        "residual": findings.residual,
        "count": len(findings.shakes),
    }


def _logs(plan: CalibrationPlan) -> dict[str, dict[str, str]]:
    """Return file and hash of the logs of single steps."""
    return {
        f"{name}.{device}": dict(part.provenance)
        for name, step in plan.settings.steps.items()
        for device, part in step.device.items()
        if "sha256" in part.provenance
    }


def _calibration(plan: CalibrationPlan, findings: StepFindings, facts: DeviceFacts) -> Calibration:
    """Return the calibration by the results so far, with the identity of its devices and its tip.

    `facts` are what live devices reported of themselves, by name.
    """
    roles = ("force", "position", "velocity")
    channels = {}
    for role in roles:
        signal = getattr(plan.alignment, role)
        if signal is not None:
            channels[role] = signal.channel
    # The devices of the plan, and those that a step has of its own.
    parts = dict(plan.devices)
    for step in plan.settings.steps.values():
        parts = dict(step.device) | parts
    devices = identity_of(parts, channels)
    for name in devices:
        devices[name] |= facts.get(name, {})
        devices[name]["type"] = plan.registry.name_of(type(parts[name]))
    tip: dict[str, Any] | None = None
    if len(plan.indenters) == 1:
        tip = plain_settings(next(iter(plan.indenters.values())), plan.registry)
    return Calibration(
        name=plan.run.name,
        created=datetime.now(UTC).replace(microsecond=0),
        values={name: calibrated_value(measured) for name, measured in findings.values.items()},
        channels=channels,
        devices=devices,
        tip=tip,
        shake=_shake(findings),
        spectra={role: noise_spectrum(spectrum) for role, spectrum in findings.spectra.items()},
        logs=_logs(plan),
        notes=findings.notes,
        versions={"palpate": importlib.metadata.version("palpate"), "python": platform.python_version()},
    )
