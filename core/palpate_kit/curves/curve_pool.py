"""Curves fitted side by side, by as many processes as there are cores."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial

from palpate_kit.curves.curve import Curve
from palpate_kit.curves.curve_fits import CurveReader, Row, fit_curves, loss_rows
from palpate_kit.jobs.portions import KILLED, in_portions


def on_cores(
    reader: CurveReader,
    curves: Iterable[Curve],
    workers: int,
    work: Callable[[CurveReader, Sequence[Curve]], list[list[Row]]] = fit_curves,
) -> Iterator[list[Row]]:
    """Yield the rows of every curve in the order of the curves, whatever the number of processes.

    A curve that kills its process gets a row with that error.
    """
    return in_portions(partial(work, reader), curves, workers, partial(loss_rows, reader, reason=KILLED))
