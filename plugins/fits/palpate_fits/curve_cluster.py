"""Curves fitted on the workers of a scheduler."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import closing
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

from palpate_kit.curves.curve import Curve
from palpate_kit.curves.curve_fits import CurveReader, Row, fit_curves, loss_rows
from palpate_kit.jobs.cluster import connect_scheduler, loss_reason, spread

_PORTION = 64  # curves of one task (choice): a scheduler costs time for each task


def on_workers(address: str, folder: Path, reader: CurveReader, curves: Iterable[Curve]) -> Iterator[list[Row]]:
    """Yield the rows of every curve, as they are ready, from workers that see the folder and the curves' files.

    Where a portion of curves has killed its workers, each of them is fitted alone; one that kills them again is
    reported and skipped. Raises ConfigurationError where nobody answers or the workers are not as here, and UserError
    where nobody has worked for five minutes.
    """
    remaining = iter(curves)
    with connect_scheduler(address, folder) as client:
        portions = iter(lambda: tuple(islice(remaining, _PORTION)), ())
        doubtful: list[Curve] = []
        for portion, outcome in _outcomes(client, reader, portions):
            if isinstance(outcome, Exception):
                doubtful += portion
            else:
                yield from outcome
        # One after the other: curves that wait at a worker that dies are blamed as well.
        for curve in doubtful:
            for _, outcome in _outcomes(client, reader, [(curve,)]):
                if isinstance(outcome, Exception):
                    yield loss_rows(reader, curve, loss_reason(outcome))
                else:
                    yield from outcome


def _outcomes(
    client: Any, reader: CurveReader, portions: Iterable[tuple[Curve, ...]]
) -> Iterator[tuple[tuple[Curve, ...], list[list[Row]] | Exception]]:
    """Yield each portion of curves with their rows, or with what its worker died of, as they are ready."""
    with closing(spread(client, partial(fit_curves, reader), portions)) as outcomes:
        yield from outcomes
