"""An acceptance in simulated time: the twin of a rehearsal does what is asked of a person, and nothing real moves."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import TracebackType

from palpate import PalpateError, SimulatedTwin, clock
from palpate_engine import Pipeline

from palpate_commands.acceptance.job import StrokesJob
from palpate_commands.acceptance.motion import make_strokes
from palpate_commands.acceptance.outcome import Outcome
from palpate_commands.acceptance.protocol import AcceptanceGuide, AcceptanceProtocol
from palpate_commands.acceptance.steps import AcceptanceStep, Visit
from palpate_commands.acceptance.strokes_run import MESSAGES, StrokesRun

_HAND = 0.15  # [s] until a hand does it


class ThreadJob(StrokesJob):
    """A run as a thread of simulated time: what takes a process, such as signals, is for the rig."""

    def __init__(self, pipeline: Pipeline, run: StrokesRun) -> None:
        super().__init__(run)
        run.folder.mkdir(parents=True)
        self._pipeline = pipeline
        self._thread = clock().thread(self._go, "strokes")
        self._thread.start()

    def _go(self) -> None:
        message = ""
        try:
            make_strokes(self._pipeline, self.run)
        except PalpateError as error:
            message = str(error)
        (self.run.folder / MESSAGES).write_text(message)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._thread.join()

    @property
    def is_running(self) -> bool:
        """Whether it runs."""
        return self._thread.is_alive()

    @property
    def has_processes(self) -> bool:
        """True while it runs."""
        return self.is_running

    def send(self, number: signal.Signals, group: bool = False) -> None:
        """A thread gets no signals: steps with them are not rehearsed."""
        raise NotImplementedError


def rehearsed_outcomes(
    pipeline: Pipeline, folder: Path, say: Callable[[str], None], stop_force: float | None, visits: Sequence[Visit]
) -> Iterator[tuple[dict[str, object], Outcome]]:
    """What the robot says of itself, and a step, one after the other, each with a twin of its own, as new."""
    assert pipeline.run.rehearsal is not None
    twin = pipeline.twins[pipeline.run.rehearsal]
    for number, visit in enumerate(visits, 1):
        with twin.simulated(pipeline.run.seed) as bench:
            guide = AcceptanceGuide(say, lambda text: None, _hand_of(bench))
            protocol = AcceptanceProtocol(
                pipeline, folder / f"{number:02d}", guide, lambda run: ThreadJob(pipeline, run), stop_force
            )
            (outcome,) = protocol.outcomes([visit])
        yield protocol.identity, outcome


def _hand_of(bench: SimulatedTwin) -> Callable[[AcceptanceStep], None]:
    """What a person does once, as soon as a hand can: the speed is then steady."""
    done: list[str] = []

    def act(step: AcceptanceStep) -> None:
        if step.fault and not done:
            done.append(step.fault)
            clock().thread(lambda: _soon(bench, step.fault), "hand").start()

    return act


def _soon(bench: SimulatedTwin, fault: str) -> None:
    clock().sleep(_HAND)
    bench.fault(fault)
