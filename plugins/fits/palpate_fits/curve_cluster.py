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

_TOGETHER = 64  # curves that a worker is given at once: what a scheduler costs is a task's


def on_workers(address: str, folder: Path, reader: CurveReader, curves: Iterable[Curve]) -> Iterator[list[Row]]:
    """Yield the rows of every curve, as they are ready, from workers that see the folder and the curves' files.

    Where a portion of curves has killed its workers, each of them is fitted alone; one that kills them again is
    reported and skipped. Raises ConfigurationError where nobody answers or the workers are not as here, and UserError
    where nobody has worked for five minutes.
    """
    left = iter(curves)
    with connect_scheduler(address, folder) as client:
        portions = iter(lambda: tuple(islice(left, _TOGETHER)), ())
        doubtful: list[Curve] = []
        for portion, outcome in _fitted(client, reader, portions):
            if isinstance(outcome, Exception):
                doubtful += portion
            else:
                yield from outcome
        for curve in doubtful:  # one after the other: what waits at a worker that dies is blamed as well
            for _, outcome in _fitted(client, reader, [(curve,)]):
                if isinstance(outcome, Exception):
                    yield loss_rows(reader, curve, loss_reason(outcome))
                else:
                    yield from outcome


def _fitted(
    client: Any, reader: CurveReader, portions: Iterable[tuple[Curve, ...]]
) -> Iterator[tuple[tuple[Curve, ...], list[list[Row]] | Exception]]:
    with closing(spread(client, partial(fit_curves, reader), portions)) as outcomes:
        yield from outcomes
