"""A UR3e with a SensONE over a specimen, in software: both twins in one world."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress

from palpate import ArmTruth, Device, HoldUp, SimulatedTwin, SupportsTwin

from palpate_simulation.twins.console import Console
from palpate_simulation.twins.fault_list import FAULTS
from palpate_simulation.twins.faults import apply_fault, make_fault
from palpate_simulation.twins.settings import BenchSettings
from palpate_simulation.twins.world import World

NICENESS = -10  # before other programs, but never at real-time priority: a driver's threads get their turn
WORK_OF_SENSOR = {"work.origin": "[-0.3, -0.13, 0.1]"}  # [m] within reach of the twin's arm, as in point_ur3e.toml
# Commands of the twins' terminal alone: they query or end the twins, or change their records.
TERMINAL_COMMANDS = ("mark", "trace", "start", "restore", "state", "quit")
REHEARSAL_FAULTS = {entry: meaning for entry, meaning in FAULTS.items() if entry.split()[0] not in TERMINAL_COMMANDS}


class SimulatedBench:
    """A bench in simulated time (a SimulatedTwin)."""

    faults = REHEARSAL_FAULTS

    def __init__(self, world: World) -> None:
        self._world = world

    def fault(self, words: str) -> None:
        """Make the fault of a line, its name and numbers; raises ConfigurationError."""
        make_fault(self._world, words.split())

    @property
    def truth(self) -> ArmTruth:
        """Extremes of the arm's true motion so far."""
        return self._world.arm_truth


class VirtualBench(BenchSettings):
    """A UR3e (RTDE 30004, dashboard 29999, script 30003) and a serial SensONE, moved by one contact physics.

    The real drivers run against it unchanged. The arm hangs over the specimen at `height`, tool downwards; the sensor
    feels contact, weight and inertia of the tip at the exact motion of the arm. `palpate twin FILE` serves it and reads
    faults from its input, one to a line; `help` lists them. On a rig the table is ignored.
    """

    @classmethod
    def stand_in(cls, devices: Mapping[str, Device], tip_mass: float | None) -> Mapping[str, str] | None:
        """Return the twin's settings for a rig: one arm with at most one sensor, or a sensor alone; None for another.

        `tip_mass` [kg] is that of the pipeline, or None where it is not stated.
        """
        tables = [device.twin_settings for device in devices.values() if isinstance(device, SupportsTwin)]
        arms = sum("robot" in table or "arm.lag" in table for table in tables)
        sensors = sum("sensor" in table for table in tables)
        if arms > 1 or sensors > 1 or (arms == 0 and not sensors == len(devices) == 1):
            return None
        settings = {key: text for table in tables for key, text in table.items()}
        if arms == 0:  # the table of a sensor has no work frame
            settings |= WORK_OF_SENSOR
        return {**settings, "tip_mass": str(tip_mass)} if tip_mass else settings

    @contextmanager
    def simulated(self, seed: int, hold_ups: Sequence[HoldUp] = ()) -> Iterator[SimulatedTwin]:
        """Yield robot and sensor in simulated time, with a seed of their noise."""
        from palpate_simulation.twins.simulated_computer import simulated

        with simulated(self, seed, hold_ups) as world:
            yield SimulatedBench(world)

    def serve(self, seed: int, ready: Callable[[Mapping[str, str]], None]) -> None:
        """Serve until SIGTERM, Ctrl-C or the end of the standard input, where that is open."""
        world = World(self, seed)
        with suppress(OSError):  # not permitted
            os.nice(NICENESS)
        try:
            for number in (signal.SIGTERM, signal.SIGINT):
                signal.signal(number, world.end)
            ready({"robot": self.host, "sensor": str(self.port)})
            world.run(Console(lambda line: apply_fault(world, line), FAULTS))
        finally:
            world.close()
