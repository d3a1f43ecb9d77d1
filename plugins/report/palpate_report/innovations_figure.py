"""The innovations of a run's filters, and whether they are white."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from palpate import Floats
from palpate_engine import RESULT
from palpate_kit.figures import legend_outside, quartiles
from palpate_kit.runs.result_file import open_table

from palpate_report.figure_subject import MAX_TRACKS, ReportFigure, Subject, pair

_QUARTILE = 0.6745  # standard deviations, within which half of a normal distribution lies


def innovations(subject: Subject) -> ReportFigure | None:
    """Innovations over their standard deviations over time, and their autocorrelation."""
    white = dict(_autocorrelations(subject))
    names = [
        name
        for name in subject.tracks
        if np.isfinite(subject.curves(name).innovation[subject.curves(name).settled]).sum() > 50
    ]
    if not names:
        return None
    figure, axes = pair(subject, 2 if white else 1)
    data: dict[str, Floats] = {}
    panel = axes[0]
    for name in names[:3]:
        curves = subject.curves(name)
        x, (low, middle, high) = quartiles(curves.time[curves.settled], curves.innovation[curves.settled], 50)
        (line,) = panel.plot(x, middle, label=name)
        panel.fill_between(x, low, high, color=line.get_color(), alpha=0.18, linewidth=0)
        data |= {f"{name}:time_s": x, f"{name}:innovation": middle, f"{name}:low": low, f"{name}:high": high}
    for level in (-_QUARTILE, 0.0, _QUARTILE):
        panel.axhline(level, color="black", linewidth=0.5, linestyle="-" if level == 0 else ":")
    panel.set(xlabel="time [s]", ylabel="innovation / its std")
    for name, (lags, shares, _) in list(white.items())[:MAX_TRACKS]:
        axes[1].plot(1e3 * lags, shares, marker=".", markersize=2, linewidth=0.7, label=name)
        data |= {f"{name}:lag_s": lags, f"{name}:autocorrelation": shares}
    if white:
        bound = max(2 / np.sqrt(samples) for _, _, samples in white.values())
        axes[1].axhspan(-bound, bound, color="0.85", linewidth=0)
        axes[1].set(xlabel="lag [ms]", ylabel="autocorrelation")
        axes[1].set_ylim(min(-0.2, *axes[1].get_ylim()), max(0.4, axes[1].get_ylim()[1]))
        legend_outside(axes[1])
    else:
        legend_outside(panel)
    caption = (
        "Innovations: median and middle half (dotted: of white noise of the expected size); their "
        "autocorrelation over the later half of the record (grey: where 95 % of that of white noise lies)"
    )
    return ReportFigure(figure, caption, data)


def _autocorrelations(subject: Subject) -> Iterator[tuple[str, tuple[Floats, Floats, float]]]:
    """Of each track that has some: lags [s], shares, and how many samples they are of; raises LogError."""
    tracks = subject.record.document.get("tracks", {})
    for name in subject.tracks:
        table = tracks.get(name, {}).get("diagnoses", {}).get("innovations")
        if table is None:
            continue
        with open_table(subject.record.folder.path / RESULT, f"tracks.{name}.diagnoses.innovations"):
            shares: Floats = np.array(table["autocorrelation"], np.float64)
            lags = float(table["interval"]) * np.arange(1.0, len(shares) + 1)
            samples = float(table["samples"])
        yield name, (lags, shares, samples)
