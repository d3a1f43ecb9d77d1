"""The matrix of the verdict: proportions with their 95 % intervals (Wilson 1927), next to what is required."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any

from verdict_records.hidden import HIDDEN
from verdict_records.wrongs import WRONGS

Row = dict[str, Any]
_DOUBT = ("doubtful", "invalid", "not determined")


def matrix(rows: Sequence[Row]) -> str:
    """The table in Markdown, and what fails behind it."""
    lines = ["| records | what | measured | 95 % | required |", "|---|---|---|---|---|"]
    for row, words in (("right", "right, everything stated"), ("nothing", "right, nothing stated but the tip")):
        lines += [f"| {words} | {line}" for line in _right([r for r in rows if r["row"] == row], row == "right")]
    lines += [f"| wrong, and it shows | {line}" for line in _wrong([r for r in rows if r["row"] == "wrong"])]
    lines += [f"| memory | {line}" for line in _remembering([r for r in rows if r["row"] == "memory"])]
    lines += [f"| wrong, and nothing shows | {line}" for line in _hidden([r for r in rows if r["row"] == "hidden"])]
    lines += [f"| real logs | {line}" for line in _real([r for r in rows if r["row"] == "real"])]
    return "\n".join([*lines, "", *_by_rig(rows), *_by_kind(rows)])


def interval(hits: int, count: int) -> tuple[float, float]:
    """95 % interval of a proportion.

    >>> low, high = interval(9, 10)
    >>> round(low, 3), round(high, 3)
    (0.596, 0.982)
    """
    z, share = 1.959964, hits / count
    middle = (share + z * z / (2 * count)) / (1 + z * z / count)
    half = z / (1 + z * z / count) * math.sqrt(share * (1 - share) / count + z * z / (4 * count * count))
    return middle - half, middle + half


def _line(what: str, told: Sequence[bool], wanted: str) -> Iterator[str]:
    if told:
        low, high = interval(sum(told), len(told))
        share = f"{sum(told)} of {len(told)} ({100 * sum(told) / len(told):.0f} %)"
        yield f"{what} | {share} | {100 * low:.0f} to {100 * high:.0f} | {wanted} |"


def _right(rows: Sequence[Row], stated: bool) -> Iterator[str]:
    read = [row for row in rows if "refused" not in row]
    yield from _line("row `good`", [row.get("verdict") == "good" for row in rows], "97 %" if stated else "95 %")
    yield from _line("a false finding", ["refused" in row or bool(row["findings"]) for row in rows], "2 % at most")
    yield from _line(
        "E in 2u", [_covered(row, "elasticity") for row in read if _number(row, "elasticity")], "93 to 99 %"
    )
    eta = [row for row in read if _number(row, "viscosity")]
    known = [row for row in eta if row["viscosity"]["verdict"] == "good"]
    yield from _line("eta in 2u, where it is `good`", [_covered(row, "viscosity") for row in known], "93 %")
    if not stated:
        yield from _line("eta `good` and 3 u wrong", [not _covered(row, "viscosity", 3.0) for row in known], "none")
        good = [row for row in read if row["elasticity"]["verdict"] == "good"]
        yield from _line("E `good` and 3 u wrong", [not _covered(row, "elasticity", 3.0) for row in good], "none")
        yield from _line("conditions are listed", [bool(row["conditions"]) for row in read], "all")


def _wrong(rows: Sequence[Row]) -> Iterator[str]:
    causes = {kind.name: kind.causes for kind in WRONGS}
    there = [row for row in rows if not row.get("unreachable")]
    for sigma in sorted({row["sigma"] for row in there}):
        here = [row for row in there if row["sigma"] == sigma]
        wanted = "90 %" if sigma < 10 else "95 %"
        yield from _line(f"reported at {sigma} sigma", [_told(row) or _found(row) for row in here], wanted)
        yield from _line(f"of them doubtful or without a number at {sigma}", [_told(row) for row in here], "")
        told = [row for row in here if _told(row) or _found(row)]
        named = [_named(row, causes[row["kind"]]) for row in told]
        yield from _line(f"with its cause, of those reported at {sigma}", named, "80 %")
        silent = [not _told(row) and not _covered(row, "elasticity", 1.0) for row in here]
        yield from _line(f"E `good` and off by more than u at {sigma}", silent, "none" if sigma == 50 else "")


def _remembering(rows: Sequence[Row]) -> Iterator[str]:
    """Of a material with memory: the Kelvin-Voigt law that is nearest to it is the truth."""
    reachable = [row for row in rows if not row.get("unreachable")]
    right = [row for row in reachable if not row["kind"]]
    wrong = [row for row in reachable if row["kind"]]
    yield from _line("every fact right: E `good`", [not _told(row) for row in right], "")
    yield from _line("every fact right: E in 2u", [_covered(row, "elasticity") for row in right], "")
    yield from _line(
        "one fact wrong: reported, or E in 2u", [_told(r) or _covered(r, "elasticity") for r in wrong], "67 %"
    )


def _named(row: Row, causes: Sequence[str]) -> bool:
    return any(cause in row.get("words", row.get("refused", "").lower()) for cause in causes)


def _hidden(rows: Sequence[Row]) -> Iterator[str]:
    facts = {kind.name: kind.facts for kind in HIDDEN}
    listed = [bool(set(facts[row["kind"]]) & set(row.get("facts", ()))) for row in rows]
    yield from _line("the fact is listed", listed, "100 %")
    yield from _line("a finding", [bool(row.get("findings")) for row in rows], "")


def _real(rows: Sequence[Row]) -> Iterator[str]:
    for row in rows:
        if "verdict" in row:
            what = f"{row['kind']}, {'stated' if row['stated'] else 'nothing stated'}"
            e, eta = row["elasticity"], row["viscosity"]
            said = f"row {row['verdict']}; E {_text(e, 1e-3)} kPa {e['verdict']}, eta {_text(eta, 1.0)} Pa s"
            said = f"{said} {eta['verdict']}"
            findings = (
                f"{len(row['findings'])} findings: {', '.join(row['findings'])}" if row["findings"] else "no finding"
            )
            yield f"{what} | {said}; {findings} | | at most one finding |"


def _text(value: Row, factor: float) -> str:
    if value["value"] is None:
        return "none"
    u = "?" if value["combined"] is None else f"{factor * value['combined']:.3g}"
    return f"{factor * value['value']:.4g} ± {u}"


def _told(row: Row) -> bool:
    return "refused" in row or row["verdict"] in _DOUBT


def _found(row: Row) -> bool:
    """Whether a finding is there, though it moves no value that is determined beyond its uncertainty."""
    return bool(row.get("findings") or row.get("immaterial"))


def _number(row: Row, name: str) -> bool:
    value = row.get(name, {})
    return value.get("value") is not None and value.get("combined") is not None


def _covered(row: Row, name: str, times: float = 2.0) -> bool:
    value = row.get(name)
    if value is None or not _number(row, name):
        return False
    return bool(abs(value["value"] - row["truth"][name]) <= times * value["combined"])


def _by_rig(rows: Sequence[Row]) -> Iterator[str]:
    """Of right records, by rig: how many are good, and the findings of the others."""
    rigs = dict.fromkeys(row["rig"] for row in rows if row["row"] in ("right", "nothing"))
    if rigs:
        yield from ("| rig | stated: `good` | findings | nothing stated: `good` | findings |", "|---|---|---|---|---|")
    for rig in rigs:
        cells = []
        for name in ("right", "nothing"):
            here = [row for row in rows if row["row"] == name and row["rig"] == rig]
            codes = Counter(code for row in here for code in row.get("findings", ["refused"]))
            good = sum(row.get("verdict") == "good" for row in here)
            cells += [f"{good} of {len(here)}", ", ".join(f"{code} {count}" for code, count in codes.most_common())]
        yield f"| {rig} | {' | '.join(cells)} |"
    if rigs:
        yield ""


def _by_kind(rows: Sequence[Row]) -> Iterator[str]:
    """Of wrong records, by kind: how many are reported at each size, and how many with their cause."""
    wrong = [row for row in rows if row["row"] == "wrong"]
    if wrong:
        yield from ("| wrong | 6 | 12 | 50 sigma | cause named | findings |", "|---|---|---|---|---|---|")
    for kind in WRONGS:
        mine = [row for row in wrong if row["kind"] == kind.name]
        if not mine:
            continue
        cells = []
        for sigma in (6, 12, 50):
            here = [row for row in mine if row["sigma"] == sigma and not row.get("unreachable")]
            cells.append(f"{sum(_told(row) or _found(row) for row in here)} of {len(here)}" if here else "-")
        told = [row for row in mine if not row.get("unreachable") and (_told(row) or _found(row))]
        cells.append(f"{sum(_named(row, kind.causes) for row in told)} of {len(told)}")
        codes = Counter(code for row in told for code in row.get("findings", ["refused"]))
        cells.append(", ".join(f"{code} {count}" for code, count in codes.most_common(3)))
        yield f"| {kind.name} | {' | '.join(cells)} |"
