"""Which thresholds decide anything: results judged again with thresholds doubled and halved.

``python benchmarks/thresholds.py`` fits one record of each kind of `verdicts.py`, of the filters, of a sweep and, where
they are, the real ones of `real_records.py`, each once. Its results are then judged again, without a fit, with the
constants of the page of thresholds times 2 and 0.5: ten at once, fewer where a verdict, a flag or an open fact changes,
down to the one that does it. What changes none of these is tried again by its effect on uncertainties and named causes.
Laws, numerics and what keeps records are left out. Of a share from 0.9 to 1 the distance from 1 is doubled or halved.
A whole number stays one, and an odd one odd.
"""

from __future__ import annotations

import math
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from time import process_time
from types import CodeType, FunctionType, ModuleType
from typing import Any

from palpate_engine.pipeline import Result
from scaled_thresholds import Constant, constants, forget, modules, replaced
from threshold_records import Judge, stored_records

FACTORS = (2.0, 0.5)
GROUP = 10  # thresholds that are changed at once
MIN_CHANGE = 0.01  # of an uncertainty, below which it counts as the same
Judgement = dict[str, Any]  # verdicts, flags and facts by name, or uncertainties and causes


@dataclass(frozen=True)
class Record:
    """A record that is judged again and again."""

    name: str
    judge: Judge
    seconds: float  # of processor time, of a judgement
    names: frozenset[tuple[str, str]]  # files and names that the code which judges it refers to

    def reads(self, constant: Constant) -> bool:
        """Return True if judging the record refers to a threshold; a public one may be read in any file."""
        if constant.name.startswith("_"):
            return (str(constant.module.__file__), constant.name) in self.names
        return any(name == constant.name for _, name in self.names)


def stored(judging: Sequence[ModuleType], folder: Path) -> Iterator[Record]:
    """Yield the records, each with the time that a judgement takes, and with all that it refers to."""
    for name, judge in stored_records(folder):
        begin = process_time()
        judgement = findings(judge())
        seconds = process_time() - begin
        forget(judging)  # what comes out of a cache is not executed
        codes = set[CodeType]()
        sys.setprofile(lambda frame, event, _, codes=codes: codes.add(frame.f_code) if event == "call" else None)
        try:
            assert not difference(judgement, findings(judge())), f"{name} is not judged twice alike"
        finally:
            sys.setprofile(None)
        yield Record(name, judge, seconds, frozenset(_names(codes, judging)))


def _names(codes: Set[CodeType], judging: Sequence[ModuleType]) -> Iterator[tuple[str, str]]:
    """Yield file and name of what executed code refers to, the defaults of its arguments included."""
    for code in codes:
        yield from ((code.co_filename, name) for name in code.co_names)
    for module in judging:
        functions = [
            each for each in vars(module).values() if isinstance(each, FunctionType) and each.__code__ in codes
        ]
        defaults = {id(value) for function in functions for value in function.__defaults__ or ()}
        yield from ((str(module.__file__), name) for name, value in vars(module).items() if id(value) in defaults)


def findings(result: Result) -> Judgement:
    """Return verdicts, flags and open facts, as text by what they are of."""
    texts: list[str] = [flag.code for flag in result.flags]
    for name, track in result.tracks.items():
        texts.append(f"{name} {track.verdict}")
        values = {**track.parameters, **{value.name: value.found for value in track.derived}}
        texts += [f"{name} {key} {value.verdict}" for key, value in values.items()]
        texts += [f"{name} {flag.code} {flag.severity} {flag.moves}" for flag in track.flags]
        texts += [f"{name} {flag.code} immaterial" for flag in track.immaterial]
        texts += [f"{name} fact {condition.fact}" for condition in track.conditions]
    return dict.fromkeys(texts, 0.0)


def uncertainties(result: Result) -> Judgement:
    """Return the combined uncertainty of each value, and the causes that each flag names."""
    judgement: Judgement = {}
    for name, track in result.tracks.items():
        judgement |= {f"{name} u({key})": value.combined for key, value in track.parameters.items()}
        judgement |= dict.fromkeys((f"{name} {flag.code} {flag.suspects}" for flag in track.flags), 0.0)
    return judgement


def difference(before: Judgement, after: Judgement) -> str:
    """Return the first entry in which two judgements differ; empty where none does."""
    for key in sorted(before.keys() | after.keys()):
        first, second = before.get(key), after.get(key)
        if first is None or second is None:
            return f"{'+' if first is None else '-'} {key}"
        if math.isnan(first) != math.isnan(second) or abs(second - first) > MIN_CHANGE * abs(first):
            return f"{key} {first:.3g} -> {second:.3g}"
    return ""


def search(
    records: Sequence[Record],
    candidates: Sequence[Constant],
    judging: Sequence[ModuleType],
    judgement_of: Callable[[Result], Judgement],
) -> dict[Constant, tuple[float, str, str]]:
    """Return the thresholds that change the judgement of a record, with factor, record and what changes first."""
    changes: dict[Constant, tuple[float, str, str]] = {}
    for record in records:
        before = judgement_of(record.judge())
        for factor in FACTORS:
            untried = [constant for constant in candidates if constant not in changes and record.reads(constant)]
            groups = [untried[i : i + GROUP] for i in range(0, len(untried), GROUP)]
            while groups:
                group = groups.pop()
                with replaced(group, factor, judging):
                    change = difference(before, judgement_of(record.judge()))
                if change and len(group) == 1:
                    changes[group[0]] = factor, record.name, change
                elif change:
                    middle = len(group) // 2
                    groups += [group[:middle], group[middle:]]
        print(
            f"{process_time():.0f} s, {record.name}: {len(changes)} of {len(candidates)}", file=sys.stderr, flush=True
        )
    return changes


def main() -> None:
    """Judge every record again, and print what each threshold changes."""
    warnings.simplefilter("ignore")
    judging = modules()
    candidates = list(constants(judging))
    with tempfile.TemporaryDirectory() as folder:
        records = sorted(stored(judging, Path(folder)), key=lambda record: record.seconds)
        seconds = sum(record.seconds for record in records)
        print(f"{len(candidates)} thresholds, {len(records)} records, judged in {seconds:.0f} s")
        # What no record of the set comes to is not tried; what changes a verdict is not tried again.
        read = [constant for constant in candidates if any(record.reads(constant) for record in records)]
        decisive = search(records, read, judging, findings)
        others = [constant for constant in read if constant not in decisive]
        weighty = search(records, others, judging, uncertainties)

    print("\n| threshold | times | record | changes |\n|---|---|---|---|")
    for constant, (factor, name, change) in sorted({**decisive, **weighty}.items(), key=lambda item: str(item[0])):
        print(f"| `{constant}` | {factor:g} | {name} | {change} |")
    idle = [constant for constant in others if constant not in weighty]
    unread = [constant for constant in candidates if constant not in read]
    print(f"\n{len(decisive)} change a verdict, a flag or a fact; {len(weighty)} an uncertainty or a named cause")
    for title, group in (("change nothing", idle), ("are not read", unread)):
        print(f"\n{len(group)} {title}: {', '.join(f'`{constant}`' for constant in group)}")


if __name__ == "__main__":
    main()
