"""Runs from Python: the same path as of the command line; without a folder nothing of it stays."""

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
    """A writer that keeps samples and estimates, every one of them."""

    parameters: dict[str, tuple[Parameter, ...]]  # by track
    blocks: list[Samples] = field(default_factory=list)
    found: dict[str, list[Estimates]] = field(default_factory=dict)

    def batch(self, device: str, batch: Batch) -> None:
        """Raw readings are not kept."""

    def samples(self, samples: Samples) -> None:
        """Keep a block."""
        self.blocks.append(samples)

    def estimates(self, track: str, estimates: Estimates) -> None:
        """Keep the estimates of a track."""
        self.found.setdefault(track, []).append(estimates)

    @classmethod
    def of(cls, outcome: RecordOutcome) -> RunRecorder:
        """What a record in memory came to."""
        parameters = {str(track.name): track.model.parameters for track in outcome.pipeline.tracks}
        return cls(parameters, [outcome.samples], {name: list(found) for name, found in outcome.estimates.items()})

    @property
    def joined(self) -> Samples | None:
        """All samples; None without any."""
        return Samples.joined(self.blocks) if self.blocks else None

    def tables(self, tracks: Iterable[str]) -> dict[str, TrackTable]:
        """Return all estimates of those of the tracks that gave any."""
        return {name: self.table(name) for name in tracks if name in self.found}

    def table(self, track: str) -> TrackTable:
        """Return all estimates of a track."""
        blocks = self.found[track]

        def column(name: str) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
            return np.concatenate([getattr(block, name) for block in blocks])

        names = [parameter.name for parameter in self.parameters[track]]
        values, std = column("values"), column("std")
        samples = self.joined
        assert samples is not None
        return TrackTable(
            column("time"),
            samples.lateral[: len(values)],
            samples.position[: len(values)],
            {name: values[:, i] for i, name in enumerate(names)},
            {name: std[:, i] for i, name in enumerate(names)},
            {name: column(name) for name in ("surface", "surface_std", "force", "nis", "innovation")},
            column("status").astype(np.int64),
        )


@contextmanager
def quietly() -> Iterator[None]:
    """Numbers that are out of range become flags, in words; numpy's own warnings add nothing."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore", RuntimeWarning)
        yield


def write_run(pipeline: Pipeline) -> Path:
    """Return a temporary folder with everything that a run writes; raises UserError."""
    with run_place(None, True) as place, quietly():
        result = run_pipeline(pipeline, place)
        result.demand_whole()
    return result.folder


@contextmanager
def run_place(folder: Path | None, temporary: bool) -> Iterator[Path | None]:
    """Where the run goes; a temporary folder is removed where the run fails."""
    if not temporary:
        yield folder
        return
    made = Path(tempfile.mkdtemp(prefix="palpate-"))
    try:
        yield made
    except BaseException:
        from palpate_engine import withdraw_folder

        withdraw_folder(made)
        raise
