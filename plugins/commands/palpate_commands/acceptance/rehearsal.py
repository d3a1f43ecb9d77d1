"""An acceptance in simulated time: the twin of a rehearsal acts for the person, and nothing real moves."""

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

_REACTION_TIME = 0.15  # [s] of a hand, after the word NOW: a choice, of a person who waits for it


class ThreadJob(StrokesJob):
    """A run as a thread of simulated time; it has no process, and takes no signals."""

    def __init__(self, pipeline: Pipeline, run: StrokesRun) -> None:
        super().__init__(run)
        run.folder.mkdir(parents=True)
        self._pipeline = pipeline
        self._thread = clock().thread(self._run, "strokes")
        self._thread.start()

    def _run(self) -> None:
        """Make the strokes, and write the message of the error that stopped them."""
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
        """True while the thread runs."""
        return self._thread.is_alive()

    @property
    def has_processes(self) -> bool:
        """True while the thread runs."""
        return self.is_running

    def send(self, number: signal.Signals, group: bool = False) -> None:
        """Raise NotImplementedError: a thread gets no signals, and steps with them are not rehearsed."""
        raise NotImplementedError


def rehearsed_outcomes(
    pipeline: Pipeline, folder: Path, say: Callable[[str], None], stop_force: float | None, visits: Sequence[Visit]
) -> Iterator[tuple[dict[str, object], Outcome]]:
    """Yield the robot's description of itself and the outcome of each step, each with a twin of its own, as new."""
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
    """Return the act of a person: the fault of a step, once, a reaction time later, when the speed is steady."""
    caused: list[str] = []  # faults so far

    def act(step: AcceptanceStep) -> None:
        if step.fault and not caused:
            caused.append(step.fault)
            clock().thread(lambda: _cause(bench, step.fault), "hand").start()

    return act


def _cause(bench: SimulatedTwin, fault: str) -> None:
    clock().sleep(_REACTION_TIME)
    bench.fault(fault)
