"""A run of strokes in a process of its own, which is stopped in every way: its main program."""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

import numpy as np
from palpate import Batch, Estimates, PalpateError, Samples
from palpate_engine import Pipeline, Ports, inherited_approval, load_pipeline, run_pipeline

from palpate_commands.acceptance.strokes import Strokes, strokes_pipeline
from palpate_commands.acceptance.strokes_run import READING, READINGS, RUN, StrokesRun


class ForceRecord:
    """Readings of the force as they come (a Writer): nothing is kept back, for the process may be killed."""

    def __init__(self, file: BinaryIO, ports: Ports) -> None:
        self._file, self._port = file, ports["force"]

    def batch(self, device: str, batch: Batch) -> None:
        """Append the force's readings."""
        if (device, batch.stream) == self._port.key:
            rows = np.empty(len(batch.time), READING)
            rows["time"], rows["force"] = batch.time, batch.values[:, self._port.column]
            self._file.write(rows.tobytes())

    def samples(self, samples: Samples) -> None:
        """Not used here."""

    def estimates(self, track: str, estimates: Estimates) -> None:
        """Nothing to limit."""


def main(arguments: Sequence[str]) -> int:
    """Make the strokes; the exit code."""
    told = json.loads(arguments[0])
    threading.Thread(target=_end_with_parent, daemon=True).start()
    run = StrokesRun(Path(told["folder"]), Strokes(**told["strokes"]), told["stop_force"])
    try:
        with inherited_approval(told["approved"]):
            make_strokes(load_pipeline(Path(told["file"]), told["overrides"]), run)
    except PalpateError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    return 0


def make_strokes(pipeline: Pipeline, run: StrokesRun) -> None:
    """Make the strokes within the limits of a pipeline; raises PalpateError where they were stopped."""
    of_strokes = strokes_pipeline(pipeline, run.strokes, run.stop_force)
    with (run.folder / READINGS).open("wb", buffering=0) as file:
        result = run_pipeline(of_strokes, run.folder / RUN, observer=ForceRecord(file, of_strokes.ports))
    result.demand_whole()


def _end_with_parent() -> None:
    """Stop like by Ctrl-C where the program that guides the protocol has gone."""
    while os.read(0, 1):
        pass
    os.kill(os.getpid(), signal.SIGINT)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
