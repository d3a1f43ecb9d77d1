"""What speaks against a result, in a few lines."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence

from palpate import Flag
from palpate_engine import SEVERITIES

_SHOWN = 3  # doubts
_NAMED = 3  # tracks or files with the same doubt


def doubt_lines(flags: Mapping[str, Sequence[Flag]]) -> Iterator[str]:
    """The worst doubts of all that is named, each once with those concerned and its remedy; notes by their codes.

    The flags of each are in their order, the worst first.
    """
    concerned: dict[str, dict[str, Flag]] = {}
    for place in range(max(map(len, flags.values()), default=0)):
        for label, every in flags.items():
            if place < len(every):
                concerned.setdefault(every[place].code, {}).setdefault(label, every[place])
    worst = {code: max((flag.severity or "note" for flag in of.values()), key=_rank) for code, of in concerned.items()}
    doubts = sorted((code for code in concerned if worst[code] != "note"), key=lambda code: -_rank(worst[code]))
    for code in doubts[:_SHOWN]:
        flag = next(flag for flag in concerned[code].values() if (flag.severity or "note") == worst[code])
        yield f"{worst[code]}: {_labels(concerned[code], flags)}{flag}"
        if flag.remedy:
            yield f"  -> {flag.remedy}"
    if more := doubts[_SHOWN:]:
        yield f"and {', '.join(more)}: --details prints them"
    if notes := [code for code in concerned if worst[code] == "note"]:
        yield f"note: {', '.join(notes)} (palpate describe {notes[0]} says what it is)"


def _rank(severity: str) -> int:
    """The higher the worse."""
    return -[*map(str, SEVERITIES)].index(severity)


def _labels(concerned: Collection[str], everyone: Collection[str]) -> str:
    """``a, b: `` for those concerned, nothing where there is but one."""
    if len(everyone) == 1:
        return ""
    if len(concerned) == len(everyone):
        return "all: "
    names = list(concerned)
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return f"{', '.join(names[:_NAMED])}{more}: "
