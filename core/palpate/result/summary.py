"""What is gathered of a track while it runs, and has the last word on its values."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from palpate.contact import ContactModel
from palpate.estimation import Estimates, Samples

if TYPE_CHECKING:
    from palpate.result.outcome import TrackResult


class TrackSummary(Protocol):
    """What the function of a `palpate.Summary` answers, once for each track of a run."""

    def add(self, samples: Samples, estimates: Estimates) -> None:
        """Take in a block; the same comes of it however a record is cut into blocks."""
        ...

    def of(self, result: TrackResult, model: ContactModel, is_sweep: bool) -> TrackResult:
        """What the result becomes when the run has ended; `is_sweep`: the tip went along the surface."""
        ...
