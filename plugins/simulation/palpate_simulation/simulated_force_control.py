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

MIN_FADING = 1e-9  # of a state in a period, below which (1 - exp(-z))/z is 1 to rounding (its error is z/2)


class _ContactHistory:
    """Contact force at one place of a specimen, period after period, with the states of a model that has a memory."""

    def __init__(self, specimen: Specimen, x: float, y: float) -> None:
        self._specimen, self._x, self._y = specimen, x, y
        self._model = specimen.model
        skin = SkinUnderTip(specimen, np.array([[x, y, specimen.surface]]))
        self._theta = [float(np.ravel(parameter)[0]) for parameter in skin.theta]
        self._states = [0.0] * len(self._model.memory)
        # Factor of the force by scatter, curvature and earlier palpations.
        self._factor = 1.0
        if specimen.scatter is not None:
            self._factor = float(specimen.scatter.at(np.array([x]), np.array([y]))[0])
        if specimen.form is not None:
            self._factor *= float(np.ravel(skin.share)[0])
        if specimen.conditioning is not None:
            self._factor *= specimen.conditioning.factor(specimen.palpated)

    def force(self, height: float, speed: float, period: float) -> float:
        """Return the force [N] along the tool, with the tip at a height [m] and a speed [m/s] along z.

        To be called once for each period [s]: the states go on by one.
        """
        skin = SkinUnderTip(self._specimen, np.array([[self._x, self._y, height]]))
        depth, rate = float(skin.depth[0]), float(skin.rate(np.array([[0.0, 0.0, speed]]))[0])
        self._advance_states(depth, rate, period)
        normal_force = float(contact_force(self._model, depth, rate, self._theta, self._states, pulls=False))
        return float(skin.normal[0, 2]) * self._factor * normal_force

    def _advance_states(self, depth: float, rate: float, period: float) -> None:
        """Advance each state s by a period, with s' = a - b s, where intake a and fading b [1/s] are constant.

        With z = b period: s exp(-z) + a period (1 - exp(-z))/z. A state fades by itself alone, so the rates for s = 0
        and s = 1, which are a and a - b, give b.
        """
        count = len(self._states)
        if not count:
            return
        intakes = self._model.memory_rate(depth, rate, self._theta, [0.0] * count)
        rates_at_one = self._model.memory_rate(depth, rate, self._theta, [1.0] * count)
        for k, (intake, rate_at_one) in enumerate(zip(intakes, rates_at_one, strict=True)):
            z = (float(intake) - float(rate_at_one)) * period
            gain = float(intake) * period * (-math.expm1(-z) / z if z > MIN_FADING else 1.0)
            self._states[k] = self._states[k] * math.exp(-z) + gain


def force_controlled_motion(
    specimen: Specimen, loop: PositionLoop, times: Floats, envelope: Setpoint, law: ForceLaw, noise: Floats
) -> tuple[TrackedMotion, Setpoint]:
    """Return the motion that the force leads within an envelope (n,) at times (n,) [s], and its setpoints.

    The envelope is the lowest that a setpoint may be; `noise` (n,) [N] is that of the sensor. Raises DeviceError where
    the tip would have to leave the envelope.
    """
    lead = ForceLead.of(law, envelope.position[:, 2], loop.period)
    x, y, _ = envelope.position[0].tolist()
    columns = _led_heights(lead, _ContactHistory(specimen, x, y), loop, times, envelope.position[:, 2], noise)
    position, velocity, commands, set_position, set_velocity = (_along_z(column) for column in columns)
    position[:, :2] = set_position[:, :2] = envelope.position[:, :2]
    setpoint = replace(envelope, position=set_position, velocity=set_velocity)
    return TrackedMotion(position, velocity, commands, loop.period, loop.lag), setpoint


def _led_heights(
    lead: ForceLead, contact: _ContactHistory, loop: PositionLoop, times: Floats, floor: Floats, noise: Floats
) -> Floats:
    """Return height z, speed v, command u, and height and speed of the setpoint (5, n) at times (n,) [s].

    The setpoint is at least as high as `floor` (n,) [m]. From a period T to the next, with e = exp(-T/lag):
    u = gain (z_d - z) + damping (z_d' - v), z + u T + (v - u) lag (1 - e), u + (v - u) e.
    """
    z, v = float(floor[0]), 0.0
    decay = math.exp(-loop.period / loop.lag)
    lag_time = loop.lag * (1.0 - decay)  # [s]
    columns = np.zeros((5, len(times)))
    for i, (time, lowest, force_error) in enumerate(zip(times.tolist(), floor.tolist(), noise.tolist(), strict=True)):
        # The measured force of this period leads to its setpoint.
        lead.hear(contact.force(z, v, loop.period) + force_error)
        set_height, set_speed = lead.next(time, lowest)
        if (text := lead.fault(time, z)) is not None:
            raise DeviceError(f"device sim: {text}")
        command = loop.gain * (set_height - z) + loop.damping * (set_speed - v)
        columns[:, i] = z, v, command, set_height, set_speed
        excess = v - command
        z += command * loop.period + excess * lag_time
        v = command + excess * decay
    return columns


def _along_z(column: Floats) -> Floats:
    """Return vectors (n, 3) along z of lengths (n,)."""
    vectors = np.zeros((len(column), 3))
    vectors[:, 2] = column
    return vectors
