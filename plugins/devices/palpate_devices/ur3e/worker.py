"""The process that holds `ur_rtde`, which hangs and crashes on lost links: the servo loop at 500 Hz."""

from __future__ import annotations

import gc
import json
import mmap
import os
import random
import sys
import time
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from palpate_devices.process.child import Parent, real_time
from palpate_devices.process.lateness import Lateness
from palpate_devices.process.ring import Ring
from palpate_devices.ur3e.layout import COLUMNS, RETRACT, STOP
from palpate_devices.ur3e.robot import PLAYING, Robot
from palpate_devices.ur3e.servo import PERIOD, Commander, Law

Floats = NDArray[np.float64]

_TICK = round(PERIOD * 1e9)
_SAFE = (1, 2)  # NORMAL, REDUCED
_SAFETY = {
    3: "a protective stop",
    5: "a safeguard stop",
    6: "an emergency stop",
    7: "an emergency stop",
    8: "a safety violation",
}
_PAUSES = (3, 4)  # PAUSING, PAUSED
_BLIND = 12_000_000  # [ns] without a new state
_EXPLAIN = 10  # periods
_LISTEN_EVERY = 5  # periods; stopping goes by shared memory and does not wait
_MOST_BEHIND = 4  # periods; what is later is not made up for


def main() -> None:
    """Connect, report, servo until the parent goes or the robot fails."""
    parent, settings = Parent(int(sys.argv[1])), json.loads(sys.argv[3])
    ring = Ring(int(sys.argv[2]), COLUMNS)
    scheduling = real_time(45)
    try:
        robot = Robot(settings)
    except ImportError as error:
        parent.tell("fault", text=f"the client library is missing ({error}): pip install ur-rtde")
        os._exit(1)
    except RuntimeError as error:
        parent.tell("fault", text=f"the client library cannot connect: {' '.join(str(error).split())}")
        os._exit(1)  # its destructors sleep, hang or crash
    gc.freeze()
    gc.disable()
    parent.tell("ready", scheduling=scheduling)
    _Loop(parent, ring, robot, settings).run()


class _Loop:
    def __init__(self, parent: Parent, ring: Ring, robot: Robot, settings: dict[str, Any]) -> None:
        self._parent, self._ring, self._robot = parent, ring, robot
        self._stale, self._host_limit = settings["stale"], settings["host_limit"]
        self._law = Law(**settings["law"])
        self._lateness = Lateness(ring.head, _TICK)
        self._commander: Commander | None = None
        self._setpoint = np.zeros(7)
        self._cycles = 0

    def run(self) -> NoReturn:
        """One cycle after another, each at its deadline."""
        deadline = time.monotonic_ns() + _TICK
        while True:
            wait = max(deadline - time.monotonic_ns(), 0)
            now = self._sleep(wait)
            late = now - deadline
            self._ring.beat(now)
            self._lateness.add(now, late, self._following)
            self._cycle(now)
            # A look at a random instant between two deadlines: else a controller that ticks in step with this loop
            # would always be seen equally late, and its clock mapped wrongly by up to a period.
            rest = deadline + _TICK - time.monotonic_ns()
            if rest > _TICK // 4:
                self._sleep(round(rest * random.uniform(0.0, 0.95)))
                self._take_state()
            deadline += _TICK
            behind = time.monotonic_ns() - deadline
            if behind > _MOST_BEHIND * _TICK:
                if self._following:
                    self._lateness.skipped(behind + _TICK)
                deadline += behind + _TICK

    @property
    def _following(self) -> bool:
        return self._commander is not None and self._commander.mode == "follow"

    def _sleep(self, duration: int) -> int:
        """Sleep [ns]; the time then. What it takes longer is counted as the host's."""
        if duration <= 0:
            return time.monotonic_ns()
        until = time.monotonic_ns() + duration
        time.sleep(duration / 1e9)
        now = time.monotonic_ns()
        if self._following:
            self._lateness.overslept(now - until)
        return now

    def _cycle(self, now: int) -> None:
        self._take_state()
        self._check(now)
        self._listen(now)
        robot, commander = self._robot, self._commander
        if commander is None:
            return
        if commander.mode == "done":
            self._finish()
        if commander.mode == "hold":
            robot.control.kickWatchdog()
            self._setpoint = commander.setpoint
            return
        self._setpoint = commander.setpoint
        position, velocity = robot.place()
        # A law that reads a frozen position would drive on and on: without news the arm waits where it is.
        blind = now - robot.seen > _BLIND and commander.mode in ("approach", "follow")
        if not robot.servo(commander.command if blind else commander.next(position, velocity)):
            for _ in range(_EXPLAIN):  # the state that says why comes on another connection
                self._take_state()
                self._check(time.monotonic_ns())
                time.sleep(PERIOD)
            self._fail("the robot refuses commands: its program has ended (out of reach, or stopped)")
        if commander.lags(position):
            self._halt()
            self._fail("the arm does not follow: it is more than 20 mm from its command")

    def _take_state(self) -> None:
        robot = self._robot
        if robot.poll():
            if self._commander is None:
                self._commander = Commander(self._law, robot.place()[0])
                self._setpoint = self._commander.setpoint
            stamps = round(robot.stamp * 1e9), robot.seen
            self._ring.write(stamps, [*robot.state, *robot.modes, *self._setpoint])

    def _check(self, now: int) -> None:
        robot = self._robot
        _, safety, runtime = robot.modes
        if safety not in _SAFE:
            self._fail(f"the robot is in {_SAFETY.get(safety, f'safety mode {safety}')}")
        if runtime in _PAUSES:
            self._fail("the robot's program was paused on the pendant")
        if runtime != PLAYING:
            self._fail("the robot's program was stopped (pendant, dashboard, watchdog or a pose out of reach)")
        age = (now - robot.seen) / 1e9
        if not robot.receive.isConnected():
            self._fail("the controller has closed the link")
        if age > self._stale:
            self._fail(f"the controller is silent: its last state is {1e3 * age:.0f} ms old")

    def _listen(self, now: int) -> None:
        head, commander = self._ring.head, self._commander
        self._cycles += 1
        for message in self._parent.messages() if self._cycles % _LISTEN_EVERY == 0 else ():
            if message["say"] == "follow" and commander is not None:
                commander.follow(_table(self._parent.descriptors.pop(0), message["rows"]))
            elif message["say"] == "close":
                self._leave()
        beat = self._ring.last_beat(host=True)
        if self._parent.gone:
            self._leave()
        if head[STOP]:
            self._finish()
        elif commander is not None:
            silent = commander.mode != "hold" and (now - beat) / 1e9 > self._host_limit
            if head[RETRACT] or silent:
                commander.retract()

    def _finish(self) -> NoReturn:
        """The motion is over, one way or the other."""
        self._halt()
        self._parent.tell("done")
        while not self._parent.gone:
            self._ring.beat(time.monotonic_ns())
            self._take_state()
            if any(message["say"] == "close" for message in self._parent.messages()):
                break
            time.sleep(PERIOD)
        os._exit(0)

    def _halt(self) -> None:
        """Stop servoing, then the program; both wait for the controller, who was heard of a moment ago."""
        self._robot.control.servoStop()
        self._robot.control.stopScript()

    def _leave(self) -> NoReturn:
        self._halt()
        os._exit(0)

    def _fail(self, text: str) -> NoReturn:
        """Say why and go at once: the library's destructors and reconnecting threads are what hangs and crashes."""
        self._parent.tell("fault", text=text)
        os._exit(1)


def _table(descriptor: int, rows: int) -> Floats:
    memory = mmap.mmap(descriptor, rows * 7 * 8)
    os.close(descriptor)
    return np.frombuffer(memory, np.float64).reshape(rows, 7)


if __name__ == "__main__":
    main()
