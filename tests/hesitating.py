"""A rig in virtual time whose servo loop the host holds up: the arm hesitates, and makes up for it.

The law of the commands (`Commander`) and the arm that follows them are those of the live path and its twin, along one
axis. While the loop is held up no command goes out and no state is read; the sensor, a process of its own, reads on.
"""

from contextlib import nullcontext

import numpy as np
from palpate import Batch
from palpate_arms.servo import Commander
from palpate_arms.servo_law import ServoLaw
from palpate_arms.setpoint_buffer import Plan
from palpate_simulation.sensor_wrench import sensed_wrench
from palpate_simulation.simulated_rig import SimulatedRig
from palpate_simulation.skin_under_tip import SkinUnderTip
from palpate_simulation.twins.arm import TICK, SimulatedArm

LAW = ServoLaw("pd", gain=20.0, damping=0.5, approach_speed=0.02, retract_speed=0.05, acceleration=1.0, max_speed=0.2)
LOOKAHEAD, GAIN = 0.03, 1000.0  # of servoL


def hesitate(monkeypatch, held_up, often):
    """From now on every simulated rig of this test is held up, for so long [s] and so often [1/s]."""
    monkeypatch.setattr(
        SimulatedRig, "connect", lambda rig, seed: nullcontext(HesitatingLink(rig, seed, held_up, often))
    )


class HesitatingLink:
    """A simulated rig at work (an Arm) whose loop is held up, for so long [s] and so often [1/s]."""

    def __init__(self, rig, seed, held_up=0.0, often=1.0):
        self._rig, self._held_up, self._often = rig, held_up, often
        self._random, self._trajectory = np.random.default_rng(seed), None

    def follow(self, trajectory):
        self._trajectory = trajectory

    def stop(self):
        pass

    def batches(self):
        rig = self._rig
        states, seen, setpoints = self._moved()
        rng, end, count = self._random, len(states) * TICK, int(np.count_nonzero(seen))
        stamps = np.rint(1e9 * TICK * np.flatnonzero(seen)).astype(np.int64)
        readings = np.arange(int(end * rig.sensor_rate)) / rig.sensor_rate
        pose, twist = np.zeros((count, 7)), np.zeros((count, 6))
        pose[:, 2], pose[:, 6], twist[:, 2] = states[seen, 0], 1.0, states[seen, 1]
        yield from _cut("wrench", np.rint(1e9 * readings).astype(np.int64), self._felt(readings, states, rng))
        yield from _cut("tip", stamps, pose)
        yield from _cut("twist", stamps, twist)
        yield from _cut("setpoint", stamps, setpoints[seen])

    def _moved(self):
        """Measured height and speed, then the true ones (n, 4), at each tick; which are seen (n,); setpoints (n, 7)."""
        rig, rng = self._rig, self._random
        plan = self._trajectory.at(np.arange(0.0, self._trajectory.total_duration, TICK))
        rows = np.hstack([plan.position, plan.velocity, plan.measuring[:, None]])
        commander = Commander(LAW, rows[0, :3])
        commander.follow(Plan.of(rows))
        arm = SimulatedArm(np.array([0.0, 0.0, rows[0, 2], 0.0, 0.0, 0.0]))
        left, due = 0, self._next_due(0.0)
        states, seen, setpoints = [], [], []
        while commander.mode != "done":
            true = arm.q[2], arm.qd[2]
            measured = true + np.array([rig.position_std, rig.velocity_std]) * rng.standard_normal(2)
            if left == 0 and len(states) * TICK >= due:
                left, due = round(self._held_up / TICK), self._next_due(due)
                missed = left
            if left == 0:
                place = commander.next(*(np.array([0.0, 0.0, value]) for value in measured))
                arm.servo(np.array([0.0, 0.0, place[2], 0.0, 0.0, 0.0]), LOOKAHEAD, GAIN)
            seen.append(left == 0)
            states.append([*measured, *true])
            setpoints.append(commander.setpoint)
            arm.advance()
            left = max(left - 1, 0)
            if not seen[-1] and left == 0:
                commander.held_up(missed)
        return np.array(states), np.array(seen), np.array(setpoints)

    def _next_due(self, due):
        """When the loop is held up again [s]: somewhere in the last half of the interval."""
        return due + (self._random.uniform(0.6, 1.4) / self._often if self._held_up else np.inf)

    def _felt(self, readings, states, rng):
        """The wrench (n, 6) at times (n,) [s]; acceleration is constant within a tick."""
        rig, before = self._rig, np.maximum(readings - self._rig.force_delay, 0.0)
        tick = np.minimum((before / TICK + 1e-9).astype(int), len(states) - 2)
        since = before - tick * TICK
        bend = np.diff(states[:, 3])[tick] / TICK
        way, speed, push = (np.zeros((len(readings), 3)) for _ in range(3))
        way[:, 2] = states[tick, 2] + states[tick, 3] * since + bend * since**2 / 2
        speed[:, 2], push[:, 2] = states[tick, 3] + bend * since, bend
        contact = rig.specimen.with_friction(SkinUnderTip(rig.specimen, way).push(before, speed), speed)
        noise, offset = rng.standard_normal((len(readings), 6)), rig.bias + rig.drift * readings
        return sensed_wrench(contact, push, rig.tip_mass, offset, noise, rig.force_std, rig.force_limit)


def _cut(stream, stamps, values):
    yield Batch(stream, stamps, stamps, values)
