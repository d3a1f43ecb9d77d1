"""Runs from Python, as from the command line; without a folder they are temporary."""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from palpate import Batch, Estimates, Parameter, Samples
from palpate_engine import Pipeline, RecordOutcome, run_pipeline
from palpate_kit.runs.run_folder import TrackTable


@dataclass
class RunRecorder:
    """Writer that keeps all samples and estimates in memory."""

    parameters: dict[str, tuple[Parameter, ...]]  # by track
    sample_blocks: list[Samples] = field(default_factory=list)
    estimate_blocks: dict[str, list[Estimates]] = field(default_factory=dict)  # by track

    def batch(self, device: str, batch: Batch) -> None:
        """Keep nothing: raw readings are in the log."""

    def samples(self, samples: Samples) -> None:
        """Keep a block of samples."""
        self.sample_blocks.append(samples)

    def estimates(self, track: str, estimates: Estimates) -> None:
        """Keep a block of estimates of a track."""
        self.estimate_blocks.setdefault(track, []).append(estimates)

    @classmethod
    def of(cls, outcome: RecordOutcome) -> RunRecorder:
        """Return the recorder of a run of a record in memory."""
        parameters = {str(track.name): track.model.parameters for track in outcome.pipeline.tracks}
        return cls(parameters, [outcome.samples], {track: list(blocks) for track, blocks in outcome.estimates.items()})

    @property
    def joined(self) -> Samples | None:
        """All samples as one block; None without samples."""
        return Samples.joined(self.sample_blocks) if self.sample_blocks else None

    def tables(self, tracks: Iterable[str]) -> dict[str, TrackTable]:
        """Return the tables of those tracks that have estimates."""
        return {name: self.table(name) for name in tracks if name in self.estimate_blocks}

    def table(self, track: str) -> TrackTable:
        """Return all estimates of a track, with the places of the samples they belong to."""
        blocks = self.estimate_blocks[track]

        def column(name: str) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
            return np.concatenate([getattr(block, name) for block in blocks])

        names = [parameter.name for parameter in self.parameters[track]]
        values, std = column("values"), column("std")
        samples = self.joined
        assert samples is not None
        return TrackTable(
            time=column("time"),
            place=samples.lateral[: len(values)],
            position=samples.position[: len(values)],
            values={name: values[:, i] for i, name in enumerate(names)},
            std={name: std[:, i] for i, name in enumerate(names)},
            others={name: column(name) for name in ("surface", "surface_std", "force", "nis", "innovation")},
            status=column("status").astype(np.int64),
        )


@contextmanager
def quietly() -> Iterator[None]:
    """Suppress warnings of numpy within the context: numbers out of range become flags."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore", RuntimeWarning)
        yield


def write_run(pipeline: Pipeline) -> Path:
    """Return a temporary folder with everything that a run writes; raises UserError."""
    with run_place(None, temporary=True) as folder, quietly():
        result = run_pipeline(pipeline, folder)
        result.demand_whole()
    return result.folder


@contextmanager
def run_place(folder: Path | None, temporary: bool) -> Iterator[Path | None]:
    """Yield the folder for a run, or a new temporary one, which is removed if the run fails."""
    if not temporary:
        yield folder
        return
    temporary_folder = Path(tempfile.mkdtemp(prefix="palpate-"))
    try:
        yield temporary_folder
    except BaseException:
        from palpate_engine import withdraw_folder

        withdraw_folder(temporary_folder)
        raise
