"""The tables and lines on many runs of one palpation, from the document of `repeat`."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from typing import Any

from palpate_engine import display_unit
from palpate_kit.numerics.group_comparison import CAUTIONS, SHOWN
from palpate_kit.terminal.layout import layout
from palpate_kit.terminal.quantities import value_with_uncertainty
from palpate_kit.terminal.result_screen import with_legend
from palpate_kit.terminal.result_table import SYMBOLS, count_words, counted
from palpate_kit.terminal.table import Table, shortened

_WITH_UNIT = ("mean", "scatter", "scatter of mean", "common", "between", "within")  # in that of the value
_DETAILS = ("scatter of mean", "common", "correlation\nof neighbours", "correlation\nwith order", "p of order")
_UNIT_SCATTER = ("between", "within")  # of a group whose units are not single values
_BAR_WIDTH = 40  # characters of the longest bar, a choice: half a line


def views(document: dict[str, Any], details: bool) -> Iterator[Any]:
    """Yield mean and scatter of every group, errors and tests; with `details` all statistics and a histogram."""
    unit_symbol, factor = display_unit(document["unit"])
    yield shortened(_group_table(document, unit_symbol, factor, details), details)
    if details:
        yield from _distributions(document, unit_symbol, factor)
    yield from _truth_lines(document, unit_symbol, factor)
    yield from _comparison(document, unit_symbol, factor, details)
    yield from _left_out_lines(document, details)
    yield _partition(document)


def _group_table(document: dict[str, Any], unit_symbol: str, factor: float, details: bool) -> Table:
    """Return a row for each group: how many units or values, mean and scatter, times the factor of the unit."""
    unit, singles = document["replication"]["unit"], document["replication"]["singles"]
    counts, count_keys = [f"{unit}s"], ["curves"]
    names = ["mean", "scatter"]
    if not singles:
        counts, count_keys = [f"units\n({unit})", "curves"], ["units", "curves"]
        names += _UNIT_SCATTER
    if details:
        names += _DETAILS
    rows = []
    for name, statistics in document["groups"].items():
        cells = _statistics_cells(statistics, factor)
        rows.append([name, *(str(statistics[key]) for key in count_keys), *(cells[key] for key in names)])
    heads = ["group", *counts, *(f"{name}\n{unit_symbol}" if name in _WITH_UNIT else name for name in names)]
    return Table.of(with_legend(document["parameter"]), heads, rows, ["group"])


def _distributions(document: dict[str, Any], unit_symbol: str, factor: float) -> Iterator[Any]:
    """Yield a histogram and the ends of the moving average of each group, and the error of its force."""
    for name, statistics in document["groups"].items():
        yield from _histogram(name, statistics, factor)
        if statistics["moving_average"]:
            first, last = statistics["moving_average"][0] * factor, statistics["moving_average"][-1] * factor
            window = statistics["moving_average_window"]
            yield f"{name}: moving average over {window} goes from {first:.5g} to {last:.5g} {unit_symbol}"
    for name, statistics in document["groups"].items():
        force_error = statistics["force_error"]
        if force_error is not None:
            largest = max(force_error["mean"], key=abs)  # [N]
            yield (
                f"{name}: force less model over {force_error['count']} runs: {1e3 * force_error['rms']:.3g} mN RMS, "
                f"mean at most {1e3 * largest:+.3g} mN"
            )


def _truth_lines(document: dict[str, Any], unit_symbol: str, factor: float) -> Iterator[str]:
    """Yield the error of each group against a stated truth, if there is one."""
    for name, statistics in document["groups"].items():
        error = statistics.get("truth")
        if error:
            error_text = f"{100 * error['error']:+.2f} ± {100 * error['error_std']:.2g} %"
            scatter = f"{100 * error['by_scatter']:.2g} %"
            yield f"{name}: {error_text} from {error['truth'] * factor:.5g} {unit_symbol} (scatter alone {scatter})"


def _comparison(document: dict[str, Any], unit_symbol: str, factor: float, details: bool) -> Iterator[Any]:
    """Yield the scatter between and within units, the tests between groups, and cautions on them."""
    replication = document["replication"]
    if replication["icc"] is not None and replication["within"] is not None:
        between, within = (f"{replication[key] * factor:.3g} {unit_symbol}" for key in _UNIT_SCATTER)
        yield f"scatter between units {between}, within them {within}: ICC {replication['icc']:.2f}"
    if document["tests"]:
        yield document["sentence"]
        yield _pair_table(document, unit_symbol, factor, details)
    anova = document["anova"]
    if anova:
        yield f"Welch's analysis of variance: F = {anova['f']:.3g}, p = {anova['p']:.2g}"
    if document["games_howell_is_liberal"]:
        yield "Games-Howell is liberal with fewer than 10 units in a group: it finds too many differences"
    if document["untested"] and document["untested"] not in document["sentence"]:
        yield document["untested"]
    if document["tests"] and replication["singles"]:
        yield CAUTIONS[replication["unit"]]


def _left_out_lines(document: dict[str, Any], details: bool) -> Iterator[str]:
    """Yield the runs that were rejected, all of them with `details`, and the number of those without a value."""
    lines = [f"{name} was rejected and is left out: {reason}" for name, reason in document["rejected"].items()]
    yield from lines if details else lines[:SHOWN]
    if len(lines) > SHOWN and not details:
        yield f"and {len(lines) - SHOWN} more"
    if document["skipped"]:
        yield f"{document['skipped']} runs without a value, or with an invalid one, were left out"


def _partition(document: dict[str, Any]) -> str:
    """Return the line with the number of values of all groups, of those with each verdict, and of rejected ones."""
    verdicts = Counter[str]()
    for group_verdicts in document["verdicts"].values():
        verdicts.update(group_verdicts)
    symbol = SYMBOLS.get(document["parameter"], document["parameter"])
    line = f"{counted(verdicts.total(), 'value')}. {symbol}: {count_words(verdicts)}"
    rejected_count = len(document["rejected"])
    return f"{line}; {rejected_count} more rejected" if rejected_count else line


def _statistics_cells(statistics: dict[str, Any], factor: float) -> dict[str, str]:
    """Return the cells of a group by heading, with numbers times the factor of their unit."""
    combined = statistics["combined_of_mean"]
    mean_std = math.nan if combined is None else combined
    trend = statistics["correlation_with_order"]

    def number(key: str) -> str:
        """Return a statistic in the unit that is shown."""
        return "-" if statistics[key] is None else f"{statistics[key] * factor:.3g}"

    def correlation(key: str) -> str:
        """Return a correlation coefficient."""
        return "-" if statistics[key] is None else f"{statistics[key]:+.2f}"

    return {
        "mean": value_with_uncertainty(statistics["mean"] * factor, mean_std * factor),
        "scatter": number("std"),
        "between": number("between"),
        "within": number("within"),
        "scatter of mean": number("std_of_mean"),
        "common": number("common"),
        "correlation\nof neighbours": correlation("correlation"),
        "correlation\nwith order": correlation("correlation_with_order"),
        "p of order": "-" if trend is None else f"{statistics['correlation_with_order_p']:.2g}",
    }


def _histogram(name: str, statistics: dict[str, Any], factor: float) -> Iterator[str]:
    """Yield a line for each bin: its edges times the factor of their unit, a bar and the count."""
    counts, edges = statistics["histogram"]["counts"], statistics["histogram"]["edges"]
    max_count = max(counts, default=0)
    if max_count:
        yield f"{name}:"
    for count, low, high in zip(counts, edges, edges[1:], strict=False):
        bar = "#" * round(_BAR_WIDTH * count / max_count)
        yield f"  {low * factor:10.5g} .. {high * factor:10.5g}  {bar} {count}"


def _pair_table(document: dict[str, Any], unit_symbol: str, factor: float, details: bool) -> Any:
    """Return the table of pairs of groups; of many, without `details`, those with the smallest p, in their order."""
    rows = document["tests"]
    test_count = sum(row["p"] is not None for row in rows)
    title = "Welch's t-test"
    if not test_count:
        title = "not tested"
    elif document["test"] == "mixed":
        title = "mixed model"
    p_head = "p by Holm" if test_count > 1 else "p"
    heads = ["difference of", f"means\n{unit_symbol}", "t", "degrees of\nfreedom", p_head]
    keys = ["t", "degrees_of_freedom", "p_corrected"]
    if document["games_howell_is_liberal"] is not None:
        heads.append("p by Games-\nHowell")
        keys.append("p_games_howell")
    if not details and layout() == "table" and len(rows) > SHOWN:
        # A pair that was not tested, without a p, comes last.
        by_p = sorted(range(len(rows)), key=lambda i: (rows[i]["p"] is None, rows[i]["p"] or 0.0, i))
        title += f": the {SHOWN} smallest p of {len(rows)} pairs, all with --details"
        rows = [rows[i] for i in sorted(by_p[:SHOWN])]
    cells = []
    for row in rows:
        numbers = ["-" if row[key] is None else f"{row[key]:.3g}" for key in keys]
        cells.append([row["difference_is"], f"{row['difference'] * factor:+.4g}", *numbers])
    return Table.of(title, heads, cells, ["difference of"]).view()
