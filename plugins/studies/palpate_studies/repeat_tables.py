"""What people see of many runs of one palpation."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from palpate_engine import display_unit
from palpate_kit.terminal.quantities import value_with_uncertainty
from palpate_kit.terminal.table import Table

_LENGTHS = ("mean", "scatter", "scatter of mean", "common")  # in the unit of the value
_DETAILS = ("scatter of mean", "common", "correlation\nof neighbours", "correlation\nwith order", "p of order")
_BAR = 40  # characters of the tallest bar
_CAUTION = (
    "p is the chance of such a difference between repeats at one site each. Sites of one material differ, too: before "
    "a difference is called a lump, compare it with the spread over a dozen baseline sites."
)


def views(document: dict[str, Any], details: bool) -> Iterator[Any]:
    """Mean and scatter of every group, errors and tests; with `details` all statistics and a histogram."""
    word, factor = display_unit(document["unit"])
    names = ("mean", "scatter", *(_DETAILS if details else ()))
    heads = ["group", "runs", *(f"{name}\n{word}" if name in _LENGTHS else name for name in names)]
    rows = [
        [name, str(found["count"]), *_statistics(found, factor)[: len(names)]]
        for name, found in document["groups"].items()
    ]
    yield Table.of(document["parameter"], heads, rows, ["group"]).view()
    if details:
        yield from _distributions(document, word, factor)
    yield from _judgements(document, word, factor)


def _distributions(document: dict[str, Any], word: str, factor: float) -> Iterator[Any]:
    """A histogram and an average of each group, and the error of its force."""
    for name, found in document["groups"].items():
        yield from _histogram(name, found, factor)
        if found["moving_average"]:
            ends = found["moving_average"][0] * factor, found["moving_average"][-1] * factor
            over = found["moving_average_window"]
            yield f"{name}: moving average over {over} goes from {ends[0]:.5g} to {ends[1]:.5g} {word}"
    for name, found in document["groups"].items():
        if (band := found["force_error"]) is not None:
            largest = max(band["mean"], key=abs)
            yield (
                f"{name}: force less model over {band['count']} runs: {1e3 * band['rms']:.3g} mN RMS, mean at most "
                f"{1e3 * largest:+.3g} mN"
            )


def _judgements(document: dict[str, Any], word: str, factor: float) -> Iterator[Any]:
    """The error of each group, tests between groups, and what was left out."""
    for name, found in document["groups"].items():
        if error := found.get("truth"):
            said = f"{100 * error['error']:+.2f} ± {100 * error['error_std']:.2g} %"
            scatter = f"{100 * error['by_scatter']:.2g} %"
            yield f"{name}: {said} from {error['truth'] * factor:.5g} {word} (scatter alone {scatter})"
    if whole := document["anova"]:
        pairs = ", ".join(f"{row['first']} and {row['second']} p = {row['p']:.2g}" for row in whole["pairs"])
        yield f"Welch's analysis of variance: F = {whole['f']:.3g}, p = {whole['p']:.2g}; Games-Howell: {pairs}"
    if document["tests"]:
        yield _tests(document["tests"], word, factor)
        yield _CAUTION
    for name, reason in document["rejected"].items():
        yield f"{name} was rejected and is left out: {reason}"
    if document["skipped"]:
        yield f"{document['skipped']} runs without a value, or with an invalid one, were left out"


def _statistics(found: dict[str, Any], factor: float) -> list[str]:
    std = (found["std"] or 0.0) * factor
    trend = found["correlation_with_order"]
    return [
        value_with_uncertainty(found["mean"] * factor, _or_unknown(found["combined_of_mean"]) * factor),
        f"{std:.3g}",
        f"{(found['std_of_mean'] or 0.0) * factor:.3g}",
        "-" if found["common"] is None else f"{found['common'] * factor:.3g}",
        "-" if found["correlation"] is None else f"{found['correlation']:+.2f}",
        "-" if trend is None else f"{trend:+.2f}",
        "-" if trend is None else f"{found['correlation_with_order_p']:.2g}",
    ]


def _or_unknown(value: float | None) -> float:
    return math.nan if value is None else value


def _histogram(name: str, found: dict[str, Any], factor: float) -> Iterator[str]:
    counts, edges = found["histogram"]["counts"], found["histogram"]["edges"]
    tallest = max(counts, default=0)
    if tallest:
        yield f"{name}:"
    for count, low, high in zip(counts, edges, edges[1:], strict=False):
        yield f"  {low * factor:10.5g} .. {high * factor:10.5g}  {'#' * round(_BAR * count / tallest)} {count}"


def _tests(rows: list[dict[str, Any]], word: str, factor: float) -> Any:
    from rich.table import Table

    table = Table(title="Welch's t-test", title_justify="left")
    for heading in ("difference of", f"means\n{word}", "t", "degrees of\nfreedom", "p"):
        table.add_column(heading, justify="left" if heading == "difference of" else "right")
    for row in rows:
        cells = ["-" if row[key] is None else f"{row[key]:.3g}" for key in ("t", "degrees_of_freedom", "p")]
        table.add_row(row["difference_is"], f"{row['difference'] * factor:+.4g}", *cells)
    return table
