"""What people see of many runs of one palpation."""

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

_LENGTHS = ("mean", "scatter", "scatter of mean", "common", "between", "within")  # in the unit of the value
_DETAILS = ("scatter of mean", "common", "correlation\nof neighbours", "correlation\nwith order", "p of order")
_OF_UNITS = ("between", "within")  # of a group whose units are not single values
_BAR = 40  # characters of the tallest bar


def views(document: dict[str, Any], details: bool) -> Iterator[Any]:
    """Mean and scatter of every group, errors and tests; with `details` all statistics and a histogram."""
    word, factor = display_unit(document["unit"])
    unit, singles = (document["replication"][key] for key in ("unit", "singles"))
    names = ("mean", "scatter", *(() if singles else _OF_UNITS), *(_DETAILS if details else ()))
    counts = [f"{unit}s"] if singles else [f"units\n({unit})", "curves"]
    heads = ["group", *counts, *(f"{name}\n{word}" if name in _LENGTHS else name for name in names)]
    rows = []
    for name, found in document["groups"].items():
        cells = _statistics(found, factor)
        number = [str(found["curves"])] if singles else [str(found["units"]), str(found["curves"])]
        rows.append([name, *number, *(cells[key] for key in names)])
    yield shortened(Table.of(with_legend(document["parameter"]), heads, rows, ["group"]), details)
    if details:
        yield from _distributions(document, word, factor)
    yield from _judgements(document, word, factor, details)


def _distributions(document: dict[str, Any], word: str, factor: float) -> Iterator[Any]:
    """Yield a histogram and an average of each group, and the error of its force."""
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


def _judgements(document: dict[str, Any], word: str, factor: float, details: bool) -> Iterator[Any]:
    """Yield the error of each group, tests between groups, and what was left out."""
    for name, found in document["groups"].items():
        if error := found.get("truth"):
            said = f"{100 * error['error']:+.2f} ± {100 * error['error_std']:.2g} %"
            scatter = f"{100 * error['by_scatter']:.2g} %"
            yield f"{name}: {said} from {error['truth'] * factor:.5g} {word} (scatter alone {scatter})"
    replication = document["replication"]
    if (shared := replication["icc"]) is not None and replication["within"] is not None:
        between, within = (f"{replication[key] * factor:.3g}" for key in ("between", "within"))
        yield f"scatter between units {between} {word}, within them {within} {word}: ICC {shared:.2f}"
    if document["tests"]:
        yield document["sentence"]
        yield _tests(document, word, factor, details)
    if whole := document["anova"]:
        yield f"Welch's analysis of variance: F = {whole['f']:.3g}, p = {whole['p']:.2g}"
    if document["games_howell_is_liberal"]:
        yield "Games-Howell is liberal with fewer than 10 units in a group: it finds too many differences"
    if document["untested"] and document["untested"] not in document["sentence"]:
        yield document["untested"]
    if document["tests"] and replication["singles"]:
        yield CAUTIONS[replication["unit"]]
    told = [f"{name} was rejected and is left out: {reason}" for name, reason in document["rejected"].items()]
    yield from told if details else told[:SHOWN]
    if len(told) > SHOWN and not details:
        yield f"and {len(told) - SHOWN} more"
    if document["skipped"]:
        yield f"{document['skipped']} runs without a value, or with an invalid one, were left out"
    yield _partition(document)


def _partition(document: dict[str, Any]) -> str:
    """Return how many values of all groups have which verdict, and how many are rejected."""
    words = Counter[str]()
    for of_group in document["verdicts"].values():
        words.update(of_group)
    symbol = SYMBOLS.get(document["parameter"], document["parameter"])
    line = f"{counted(words.total(), 'value')}. {symbol}: {count_words(words)}"
    rejected = len(document["rejected"])
    return f"{line}; {rejected} more rejected" if rejected else line


def _statistics(found: dict[str, Any], factor: float) -> dict[str, str]:
    trend = found["correlation_with_order"]

    def length(key: str) -> str:
        return "-" if found[key] is None else f"{found[key] * factor:.3g}"

    return {
        "mean": value_with_uncertainty(found["mean"] * factor, _or_unknown(found["combined_of_mean"]) * factor),
        "scatter": length("std"),
        "between": length("between"),
        "within": length("within"),
        "scatter of mean": length("std_of_mean"),
        "common": length("common"),
        "correlation\nof neighbours": "-" if found["correlation"] is None else f"{found['correlation']:+.2f}",
        "correlation\nwith order": "-" if trend is None else f"{trend:+.2f}",
        "p of order": "-" if trend is None else f"{found['correlation_with_order_p']:.2g}",
    }


def _or_unknown(value: float | None) -> float:
    return math.nan if value is None else value


def _histogram(name: str, found: dict[str, Any], factor: float) -> Iterator[str]:
    counts, edges = found["histogram"]["counts"], found["histogram"]["edges"]
    tallest = max(counts, default=0)
    if tallest:
        yield f"{name}:"
    for count, low, high in zip(counts, edges, edges[1:], strict=False):
        yield f"  {low * factor:10.5g} .. {high * factor:10.5g}  {'#' * round(_BAR * count / tallest)} {count}"


def _tests(document: dict[str, Any], word: str, factor: float, details: bool) -> Any:
    """Return the pairs, unless `details` those of the smallest p-values, in their order."""
    rows = document["tests"]
    tested = sum(row["p"] is not None for row in rows)
    title = "not tested" if not tested else "mixed model" if document["test"] == "mixed" else "Welch's t-test"
    heads = ["difference of", f"means\n{word}", "t", "degrees of\nfreedom", "p by Holm" if tested > 1 else "p"]
    keys = ["t", "degrees_of_freedom", "p_corrected"]
    if document["games_howell_is_liberal"] is not None:
        heads.append("p by Games-\nHowell")
        keys.append("p_games_howell")
    if not details and layout() == "table" and len(rows) > SHOWN:
        smallest = sorted(range(len(rows)), key=lambda i: (rows[i]["p"] is None, rows[i]["p"] or 0.0, i))[:SHOWN]
        title += f": the {SHOWN} smallest p of {len(rows)} pairs, all with --details"
        rows = [rows[i] for i in sorted(smallest)]
    cells = [
        [row["difference_is"], f"{row['difference'] * factor:+.4g}"]
        + ["-" if row[key] is None else f"{row[key]:.3g}" for key in keys]
        for row in rows
    ]
    return Table.of(title, heads, cells, ["difference of"]).view()
