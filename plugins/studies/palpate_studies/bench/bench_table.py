"""The tables of a bench: a row for each scene and track, and on a screen a column for each scene."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from io import StringIO
from statistics import median
from typing import Any

from palpate_kit.comparison.record_rows import Row
from palpate_kit.terminal.comparison_table import SLOW
from palpate_kit.terminal.result_screen import filled
from palpate_kit.terminal.result_table import SYMBOLS
from palpate_kit.terminal.table import Table

MANY = 100  # records of a scene, from which on its coverage is shown: a choice, with fewer a share is not known
_MAX_OFF = 2.0  # rms of errors over their combined uncertainty u: beyond it they are larger than stated; a choice
_NORMAL_95 = 1.96  # standard deviations of 95 % of a normal distribution
_MIN_WHOLE = 10  # from which on a number is shown whole, a choice: two digits
_MIN_POWER = 1e4  # from which on it is shown with an exponent, a choice: a narrow column
_LEGEND = (
    "rms error of {value} in %, in brackets of the force that the sample before predicts; ! errors of more than 2 u "
    "(rms); cost of a sample"
)


def summaries(rows: Iterable[Row]) -> list[Row]:
    """Return a row for each scene and track: rms of errors, medians of measures, and how many records failed."""
    groups: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row["scene"], row["track"]), []).append(row)
    return [_summary(scene, track, group) for (scene, track), group in groups.items()]


def _summary(scene: str, track: str, rows: Sequence[Row]) -> Row:
    """Return the summary of the records of one scene and track; a measure is None if no record has it."""
    valid = [row for row in rows if not row.get("reason")]
    names = dict.fromkeys(key.removesuffix("_error") for row in valid for key in row if key.endswith("_error"))
    summary: Row = {"scene": scene, "track": track, "records": len(rows), "failed": len(rows) - len(valid)}
    for name in names:
        summary |= _value_summary(valid, name)
    for key in ("prediction", "nis", "nis_low", "nis_high", "settled", "seconds_per_sample", "samples"):
        numbers = _numbers(valid, key)
        summary[key] = median(numbers) if numbers else None
    # The first reason of a failure, and that most of the records were slow.
    reasons = [row["reason"] for row in rows if row.get("reason")][:1]
    slow_count = sum(bool(row.get("is_slow")) for row in rows)
    if 2 * slow_count > len(rows):
        reasons.append(SLOW)
    return summary | {"reason": "; ".join(reasons)}


def _value_summary(rows: Sequence[Row], name: str) -> Row:
    """Return the summary of the errors of a value: rms of relative errors, and rms of errors over u.

    With the share of records whose error is at most 2 u, and the ends of its interval of 95 %.
    """
    offs = _numbers(rows, f"{name}_off")
    inside_count = sum(off <= _MAX_OFF for off in offs)
    low, high = _share_interval(inside_count, len(offs))
    return {
        f"{name}_error": _rms(_numbers(rows, f"{name}_error")),
        f"{name}_off": _rms(offs),
        f"{name}_within_2u": inside_count / len(offs) if offs else None,
        f"{name}_within_low": low,
        f"{name}_within_high": high,
    }


def _numbers(rows: Sequence[Row], key: str) -> list[float]:
    """Return the numbers of a column, of the rows that have one."""
    return [row[key] for row in rows if isinstance(row.get(key), int | float)]


def _rms(values: Sequence[float]) -> float | None:
    """Return the root of the mean square of values; None without any."""
    return math.sqrt(sum(value**2 for value in values) / len(values)) if values else None


def _share_interval(count: int, total: int) -> tuple[float | None, float | None]:
    """Return the ends of the interval of 95 % of the share p = count/total, by Wilson (1927); None without records.

    They are (p + z^2/2n -+ z sqrt(p (1 - p)/n + z^2/4n^2))/(1 + z^2/n) with n = total and z = 1.96.
    """
    if not total:
        return None, None
    share, z2 = count / total, _NORMAL_95**2
    middle = (share + z2 / (2 * total)) / (1 + z2 / total)
    half_width = _NORMAL_95 * math.sqrt(share * (1 - share) / total + z2 / (4 * total**2)) / (1 + z2 / total)
    return middle - half_width, middle + half_width


def scene_matrix(rows: Sequence[Row]) -> Table:
    """Return a row for each track and a column for each scene: the error of the first value, or of the prediction."""
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    tracks = list(dict.fromkeys(row["track"] for row in rows if row["track"]))
    rows_by_key = {(row["scene"], row["track"]): row for row in rows}
    # Tracks of one model are named by their estimators.
    model = next(iter({track.partition("/")[0] for track in tracks}), "")
    is_one_model = all(track.startswith(f"{model}/") for track in tracks)
    cells = []
    for track in tracks:
        name = track.partition("/")[2] if is_one_model else track
        scene_cells = [_scene_cell(rows_by_key.get((scene, track))) for scene in scenes]
        cells.append([name, *scene_cells, _cost_cell([row for row in rows if row["track"] == track])])
    head = f"{model}/" if is_one_model else "track"
    return Table("", (head, *scenes, "us"), tuple(map(tuple, cells)), (head,), is_plain=True)


def _cost_cell(rows: Sequence[Row]) -> str:
    """Return the median cost of a sample over rows [us]; a dash without any."""
    costs = [row["seconds_per_sample"] for row in rows if row["seconds_per_sample"]]  # [s]
    return _number(1e6 * median(costs)) if costs else "-"


def _scene_cell(row: Row | None) -> str:
    """Return the error of a track in a scene [%], with a mark if it is larger than stated; in brackets of the force."""
    if row is None:
        return ""
    if row["failed"] == row["records"]:
        return "failed"
    name = _first_value(row)
    if name is None:
        return f"({_percent(row['prediction'])})"
    mark = "!" if (row[f"{name}_off"] or 0.0) > _MAX_OFF else ""
    return f"{_percent(row[f'{name}_error'])}{mark}"


def _first_value(row: Row) -> str | None:
    """Return the name of the first value with an error; None without a truth."""
    return next((key.removesuffix("_error") for key in row if key.endswith("_error")), None)


def scene_table(rows: Sequence[Row], is_whole: bool = False) -> Table:
    """Return a row for each track of one scene: errors, distance in u, prediction, NIS, time to settle, cost.

    From 100 records on, it has the share of records within 2 u, with its interval. A table that `is_whole` has this and
    the reasons of failures.
    """
    names = list(dict.fromkeys(key.removesuffix("_error") for row in rows for key in row if key.endswith("_error")))
    has_coverage = is_whole or max(row["records"] for row in rows) >= MANY
    heads = ["track", "of"]
    for name in names:
        symbol = name if is_whole else SYMBOLS.get(name, name)
        heads += [f"{symbol}\nerror %", f"{symbol}\noff u"]
        if has_coverage:
            heads.append(f"{symbol}\n% in 2 u")
    heads += ["force\n%", "NIS", "settled\ns", "cost\nus"]
    if is_whole:
        heads.append("reason")
    cells = [_scene_row(row, names, has_coverage)[: len(heads)] for row in rows]
    texts = ("track", "reason")
    return Table("", tuple(heads), tuple(map(tuple, cells)), texts, is_plain=True, spare=0 if is_whole else 2)


def _scene_row(row: Row, names: Sequence[str], has_coverage: bool) -> list[str]:
    """Return the cells of a track in a scene, for values of some names, the reason of a failure last."""
    count = row["records"]
    valid_count = count - row["failed"]
    cells = [row["track"], str(count) if valid_count == count else f"{valid_count}/{count}"]
    for name in names:
        cells += [_percent(row.get(f"{name}_error")), _number(row.get(f"{name}_off"))]
        if has_coverage:
            shares = [row.get(f"{name}_within_{key}") for key in ("2u", "low", "high")]
            texts = [f"{100 * share:.0f}" for share in shares if share is not None]
            cells.append(f"{texts[0]} ({texts[1]} to {texts[2]})" if len(texts) == len(shares) else "-")
    cost = row["seconds_per_sample"]
    cells += [_percent(row["prediction"]), _number(row["nis"]), _number(row["settled"])]
    return [*cells, _number(None if cost is None else 1e6 * cost), row["reason"].partition("\n")[0]]


def lines_below(rows: Sequence[Row]) -> Iterator[str]:
    """Yield the legend of the cells, and each reason of a failure with its scenes and tracks."""
    value = next((SYMBOLS.get(name, name) for row in rows if (name := _first_value(row))), "E")
    yield from filled(_LEGEND.format(value=value), "  ")
    reasons: dict[str, list[str]] = {}
    for row in rows:
        if row["reason"]:
            reasons.setdefault(row["reason"], []).append(f"{row['scene']} {row['track']}".strip())
    for reason, failed_tracks in reasons.items():
        yield from filled(f"{', '.join(failed_tracks)}: {reason}", "  ")


def csv_text(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return rows as CSV with all of their columns [SI]."""
    text = StringIO()
    columns = dict.fromkeys(key for row in rows for key in row)
    table = csv.DictWriter(text, columns, restval="", lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    return text.getvalue()


def _percent(value: float | None) -> str:
    """Return a share in percent; a dash without one."""
    return _number(None if value is None else 100 * value)


def _number(value: float | None) -> str:
    """Return a number with two digits, from 10 on as a whole number; a dash without one."""
    if value is None or not math.isfinite(value):
        return "-"
    if value >= _MIN_POWER:
        return f"{value:.0e}"
    return f"{value:.0f}" if value >= _MIN_WHOLE else f"{value:.2g}"
