"""A run of strokes in a process of its own, which is stopped in every way: its main program."""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from palpate import Batch, Estimates, Floats, PalpateError, Samples
from palpate_engine import Pipeline, inherited_approval, load_pipeline, run_pipeline

from palpate_commands.acceptance.strokes import Strokes, strokes_pipeline
from palpate_commands.acceptance.strokes_run import FORCE, RUN, StrokesRun, row_type
from palpate_commands.acceptance.watched_arm import WatchedArm


class StrokesRecord:
    """Readings of the force and states of the arm as they come (a Writer); unbuffered, as the process may be killed.

    States are recorded of an arm that no second connection can watch.
    """

    def __init__(self, pipeline: Pipeline, run: StrokesRun, files: ExitStack) -> None:
        self._port, self._arm = pipeline.ports["force"], WatchedArm.of(pipeline)
        names = (FORCE, *(self._arm.streams if self._arm.modes.single_connection else ()))
        self._files = {name: files.enter_context(run.record(name).open("wb", buffering=0)) for name in names}

    def batch(self, device: str, batch: Batch) -> None:
        """Append readings and states."""
        if (device, batch.stream) == self._port.key:
            self._append(FORCE, batch.time, batch.values[:, self._port.column, None])
        if device == self._arm.name and batch.stream in self._files:
            self._append(batch.stream, batch.time, batch.values)

    def _append(self, name: str, time: NDArray[np.int64], values: Floats) -> None:
        rows = np.empty(len(time), row_type(values.shape[1]))
        rows["time"], rows["values"] = time, values
        self._files[name].write(rows.tobytes())

    def samples(self, samples: Samples) -> None:
        """Ignore samples: nothing is estimated."""

    def estimates(self, track: str, estimates: Estimates) -> None:
        """Ignore estimates: a run of strokes has no tracks."""


def main(arguments: Sequence[str]) -> int:
    """Make the strokes of the settings in JSON; return the exit code."""
    settings = json.loads(arguments[0])
    threading.Thread(target=_end_with_parent, daemon=True).start()
    run = StrokesRun(Path(settings["folder"]), Strokes(**settings["strokes"]), settings["stop_force"])
    try:
        with inherited_approval(settings["approved"]):
            make_strokes(load_pipeline(Path(settings["file"]), settings["overrides"]), run)
    except PalpateError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    return 0


def make_strokes(pipeline: Pipeline, run: StrokesRun) -> None:
    """Make the strokes within the limits of a pipeline; raises PalpateError where they were stopped."""
    motion = strokes_pipeline(pipeline, run.strokes, run.stop_force)
    with ExitStack() as files:
        record = StrokesRecord(motion, run, files)
        result = run_pipeline(motion, run.folder / RUN, observer=record)
    result.demand_whole()


def _end_with_parent() -> None:
    """Stop as by Ctrl-C once the program that guides the protocol has gone, which closes its end of the input."""
    while os.read(0, 1):
        pass
    os.kill(os.getpid(), signal.SIGINT)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
