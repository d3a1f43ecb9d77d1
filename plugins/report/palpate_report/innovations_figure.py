"""The innovations of a run's filters, and whether they are white."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from palpate import Floats
from palpate_engine import RESULT
from palpate_kit.figures import legend_outside, quartiles
from palpate_kit.runs.result_file import open_table

from palpate_report.figure_data import Curves
from palpate_report.figure_subject import MAX_TRACKS, QUARTILE_OPACITY, ReportFigure, Subject, pair

_QUARTILE = 0.6745  # standard deviations, within which half of a normal distribution lies
# Choices.
_MIN_SAMPLES = 50  # of innovations that are drawn
_MAX_DRAWN = 3  # tracks over time: more bands hide each other
_BINS = 50  # over time
_MIN_SHARES = (-0.2, 0.4)  # of the axis of autocorrelations, so that those of white noise look small


@dataclass(frozen=True)
class _Autocorrelation:
    """The autocorrelation of the innovations of a track."""

    lags: Floats  # (l,) [s]
    shares: Floats  # (l,) of the variance
    samples: float  # number of innovations that it is of


def innovations(subject: Subject) -> ReportFigure | None:
    """Return a figure of innovations over their standard deviations, over time, and of their autocorrelation.

    `subject` is a run with its tracks. None without a track that has innovations.
    """
    autocorrelations = dict(_autocorrelations(subject))
    names = [name for name in subject.tracks if _innovation_count(subject.curves(name)) > _MIN_SAMPLES]
    if not names:
        return None
    figure, axes = pair(subject, 2 if autocorrelations else 1)
    data = _draw_over_time(axes[0], [subject.curves(name) for name in names[:_MAX_DRAWN]])
    if autocorrelations:
        data |= _draw_autocorrelations(axes[1], autocorrelations)
    legend_outside(axes[-1])
    caption = (
        "Innovations: median and middle half (dotted: of white noise of the expected size); their "
        "autocorrelation over the later half of the record (grey: where 95 % of that of white noise lies)"
    )
    return ReportFigure(figure, caption, data)


def _innovation_count(curves: Curves) -> int:
    """Return how many innovations of a track count."""
    return int(np.isfinite(curves.innovation[curves.settled]).sum())


def _draw_over_time(panel: Any, tracks: Sequence[Curves]) -> dict[str, Floats]:
    """Draw medians and quartiles of innovations over time, and return them by column [SI].

    Lines are medians, bands quartiles, dotted lines the quartiles of white noise; `tracks` have innovations (n,) over
    their standard deviations.
    """
    data: dict[str, Floats] = {}
    for curves in tracks:
        time, (low, median, high) = quartiles(
            curves.time[curves.settled], curves.innovation[curves.settled], bins=_BINS
        )
        (line,) = panel.plot(time, median, label=curves.name)
        panel.fill_between(time, low, high, color=line.get_color(), alpha=QUARTILE_OPACITY, linewidth=0)
        prefix = f"{curves.name}:"
        data |= {f"{prefix}time_s": time, f"{prefix}innovation": median, f"{prefix}low": low, f"{prefix}high": high}
    # Quartiles of white noise of the expected size.
    for level in (-_QUARTILE, 0.0, _QUARTILE):
        panel.axhline(level, color="black", linewidth=0.5, linestyle="-" if level == 0 else ":")
    panel.set(xlabel="time [s]", ylabel="innovation / its std")
    return data


def _draw_autocorrelations(panel: Any, autocorrelations: Mapping[str, _Autocorrelation]) -> dict[str, Floats]:
    """Draw autocorrelations over the lag, with the band of white noise, and return them by column [SI]."""
    data: dict[str, Floats] = {}
    for name, autocorrelation in list(autocorrelations.items())[:MAX_TRACKS]:
        lags, shares = autocorrelation.lags, autocorrelation.shares
        panel.plot(1e3 * lags, shares, marker=".", markersize=2, linewidth=0.7, label=name)
        data |= {f"{name}:lag_s": lags, f"{name}:autocorrelation": shares}
    # That of n samples of white noise has a standard deviation of 1/sqrt(n).
    bound = max(2 / np.sqrt(autocorrelation.samples) for autocorrelation in autocorrelations.values())
    panel.axhspan(-bound, bound, color="0.85", linewidth=0)
    panel.set(xlabel="lag [ms]", ylabel="autocorrelation")
    low, high = panel.get_ylim()
    panel.set_ylim(min(_MIN_SHARES[0], low), max(_MIN_SHARES[1], high))
    return data


def _autocorrelations(subject: Subject) -> Iterator[tuple[str, _Autocorrelation]]:
    """Yield the autocorrelation of each track that has one, with its name; raises LogError."""
    tracks = subject.record.document.get("tracks", {})
    for name in subject.tracks:
        table = tracks.get(name, {}).get("diagnoses", {}).get("innovations")
        if table is None:
            continue
        with open_table(subject.record.folder.path / RESULT, f"tracks.{name}.diagnoses.innovations"):
            shares: Floats = np.array(table["autocorrelation"], np.float64)
            lags = float(table["interval"]) * np.arange(1.0, len(shares) + 1)
            samples = float(table["samples"])
        yield name, _Autocorrelation(lags, shares, samples)
