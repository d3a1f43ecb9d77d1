"""The twin of a Franka: other people's simulator of its controller, over palpate's specimen."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import ClassVar

from palpate import ConfigurationError, HoldUp, SimulatedTwin, Stiffness, UserError
from palpate_simulation.twins.bench import VirtualBench
from palpate_simulation.twins.settings import BenchSettings, TwinArm
from pydantic import Field

from palpate_franka.models import MODELS, POSTURE

MIN_CORES = 2  # one is the simulator's, as a controller is a computer of its own


class FrankaBench(BenchSettings):
    """An FR3 by franky-sim under MuJoCo with a serial SensONE over a specimen (`palpate-franka[sim]`).

    `palpate twin FILE` serves it: the client library and the sensor's driver run against it unchanged, in real time,
    for which it needs a core to itself. `palpate rehearse FILE` takes palpate's own arm in its place, in simulated
    time. The simulator has no reflexes, no Desk, no user stop and no thresholds. On a rig the table is ignored.
    """

    absent_stops: ClassVar[tuple[str, ...]] = ("emergency", "safeguard", "reflex")

    stiffness: Stiffness = Field(default=5000.0, gt=0, description="of the arm's impedance, in a rehearsal")

    def serve(self, seed: int, ready: Callable[[Mapping[str, str]], None]) -> None:
        """Serve until Ctrl-C or the end of the input; raises UserError without the simulator or a core for it."""
        try:
            import franky_sim  # noqa: F401
            import mujoco  # noqa: F401
        except ImportError as error:
            raise UserError(
                f"the simulator is not installed here ({error}): pip install 'palpate-franka[sim]'"
            ) from error
        cores = sorted(os.sched_getaffinity(0))
        if len(cores) < MIN_CORES:
            raise UserError("the simulator needs a core to itself, and this machine has one for all programs")
        if self.sensor != "bota":
            raise ConfigurationError(f'[twin.*] sensor = "{self.sensor}": this twin has a SensONE, "bota"')
        from palpate_franka.simulator.simulated_rig import serve_rig

        os.sched_setaffinity(0, cores[-1:])
        free_cores = ",".join(map(str, cores[:-1]))
        serve_rig(
            self, seed, lambda facts: ready({**facts, "core": f"{cores[-1]}; start a run by taskset -c {free_cores}"})
        )

    @contextmanager
    def simulated(self, seed: int, hold_ups: Sequence[HoldUp] = ()) -> Iterator[SimulatedTwin]:
        """Yield palpate's own arm with the kinematics of an FR3, which gives way by `stiffness`."""
        arm = TwinArm(
            model=MODELS["fr3"], lag=2.0 / math.sqrt(self.stiffness), posture=POSTURE, stiffness=self.stiffness
        )
        settings = {name: getattr(self, name) for name in BenchSettings.model_fields}
        with VirtualBench(**{**settings, "arm": arm}).simulated(seed, hold_ups) as bench:
            yield bench
