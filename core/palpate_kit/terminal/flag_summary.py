"""What a result holds for and what counts against it, in three lines."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence

from palpate import Flag
from palpate_engine import SEVERITIES

_NAMED = 3  # tracks or files with the same doubt


def summary_lines(
    flags: Mapping[str, Sequence[Flag]], facts: Mapping[str, str] | None = None, of_record: Sequence[Flag] = ()
) -> Iterator[str]:
    """At most three lines below a table: what the values hold for, what was found, and what to type.

    `facts` are the words that state each open fact, by what is assumed. The flags of each are in their order, the worst
    first: the worst doubt of all is a sentence, as are notes `of_record`, the others are codes.
    """
    if facts:
        yield f"holds if: {'; '.join(facts)}"
    concerned: dict[str, dict[str, Flag]] = {}
    for place in range(max(map(len, flags.values()), default=0)):
        for label, every in flags.items():
            if place < len(every):
                concerned.setdefault(every[place].code, {}).setdefault(label, every[place])
    worst = {code: max((flag.severity or "note" for flag in of.values()), key=_rank) for code, of in concerned.items()}
    doubts = sorted((code for code in concerned if worst[code] != "note"), key=lambda code: -_rank(worst[code]))
    found, to_type = [str(flag) for flag in of_record], list(dict.fromkeys((facts or {}).values()))
    for code in doubts[:1]:
        flag = next(flag for flag in concerned[code].values() if (flag.severity or "note") == worst[code])
        found.append(f"{worst[code]}: {_labels(concerned[code], flags)}{flag}")
        to_type += [flag.remedy] if flag.remedy else []
    if more := doubts[1:]:
        found.append(f"and {', '.join(more)}")
        to_type.append("--details")
    if notes := [code for code in concerned if worst[code] == "note"]:
        found.append(f"note: {', '.join(notes)}")
        to_type += [] if doubts else [f"palpate describe {notes[0]}"]
    if found:
        yield "; ".join(found)
    if to_type:
        yield f"-> {'; '.join(word.rstrip('.') for word in to_type)}"


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
