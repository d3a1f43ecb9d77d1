"""A simulated rig that is led by the force: the loop of the arm's own process, closed over the specimen."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from palpate import DeviceError, Floats, ForceLaw, Setpoint, contact_force
from palpate_arms.force_control import ForceLead

from palpate_simulation.simulated_arm import PositionLoop, TrackedMotion
from palpate_simulation.skin_under_tip import SkinUnderTip
from palpate_simulation.specimen import Specimen


class _ContactHistory:
    """The contact force of one period after another; states fade by themselves, their intake even over a period."""

    def __init__(self, specimen: Specimen, place: Floats) -> None:
        self._specimen, self._place = specimen, place
        self._model = specimen.model
        on_the_skin = SkinUnderTip(specimen, np.array([[*place[:2], specimen.surface]]))
        self._theta = [float(np.ravel(value)[0]) for value in on_the_skin.theta]
        self._states = [0.0] * len(self._model.memory)
        self._share = 1.0 if specimen.scatter is None else float(specimen.scatter.at(place[None, 0], place[None, 1])[0])
        if specimen.form is not None:
            self._share *= float(np.ravel(on_the_skin.share)[0])
        if specimen.conditioning is not None:
            self._share *= specimen.conditioning.factor(specimen.palpated)

    def at(self, height: float, speed: float, period: float) -> float:
        """[N] with the tip at a height [m] and speed [m/s], a period [s] after the one before."""
        under = SkinUnderTip(self._specimen, np.array([[*self._place[:2], height]]))
        depth, rate = float(under.depth[0]), float(under.rate(np.array([[0.0, 0.0, speed]]))[0])
        model, theta, count = self._model, self._theta, len(self._states)
        upright = float(under.normal[0, 2])  # of the force along the normal, that along the tool
        if count:
            taken = model.memory_rate(depth, rate, theta, [0.0] * count)
            left = model.memory_rate(depth, rate, theta, [1.0] * count)
            for k, (intake, with_one) in enumerate(zip(taken, left, strict=True)):
                z = (float(intake) - float(with_one)) * period
                gained = float(intake) * period * (-math.expm1(-z) / z if z > 1e-9 else 1.0)
                self._states[k] = self._states[k] * math.exp(-z) + gained
        return upright * self._share * float(contact_force(model, depth, rate, theta, self._states, pulls=False))


def force_controlled_motion(
    specimen: Specimen, loop: PositionLoop, times: Floats, envelope: Setpoint, law: ForceLaw, noise: Floats
) -> tuple[TrackedMotion, Setpoint]:
    """Return the motion that the force leads within an envelope (n,) at times (n,) [s], and its setpoints.

    `noise` (n,) [N] is what the sensor adds. Raises DeviceError where the tip would have to leave the envelope.
    """
    floor, place = envelope.position[:, 2], envelope.position[0]
    lead, felt = ForceLead.of(law, floor, loop.period), _ContactHistory(specimen, place)
    z, v = float(floor[0]), 0.0
    decay = math.exp(-loop.period / loop.lag)
    slide = loop.lag * (1.0 - decay)
    course = np.zeros((len(times), 5))
    for i, (time, low, added) in enumerate(zip(times.tolist(), floor.tolist(), noise.tolist(), strict=True)):
        lead.hear(felt.at(z, v, loop.period) + added)
        wanted, rate = lead.next(time, low)
        if (text := lead.fault(time, z)) is not None:
            raise DeviceError(f"device sim: {text}")
        command = loop.gain * (wanted - z) + loop.damping * (rate - v)
        course[i] = z, v, command, wanted, rate
        lacking = v - command
        z += command * loop.period + lacking * slide
        v = command + lacking * decay
    position, velocity, commands, set_position, set_velocity = (np.zeros((len(times), 3)) for _ in range(5))
    for column, values in zip((position, velocity, commands, set_position, set_velocity), course.T, strict=True):
        column[:, 2] = values
    position[:, :2] = set_position[:, :2] = envelope.position[:, :2]
    setpoint = replace(envelope, position=set_position, velocity=set_velocity)
    return TrackedMotion(position, velocity, commands, loop.period, loop.lag), setpoint
