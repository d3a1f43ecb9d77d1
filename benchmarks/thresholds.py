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
import pkgutil
import re
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence, Set
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from time import process_time
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np
from palpate_engine.pipeline import Result
from threshold_records import Judge, stored_records

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "docs"))
import make_thresholds  # noqa: E402  a module of the documents, and no package

FACTORS = (2.0, 0.5)
GROUP = 10  # thresholds that are changed at once
MIN_CHANGE = 0.01  # of an uncertainty, below which it counts as the same
_RECORDS = ("sample_keeper", "result_folder")
_NUMERICS = re.compile(
    r"SMALLEST|_STEP$|^_?DIFFERENCE$|_DIFFERENCE$(?<!BIC_DIFFERENCE)|EVALUATIONS|ROUNDING|_UNIT$|CACHED|MIN_GAIN"
    r"|BOUND_MARGIN|SURFACE_SCALE|_SPAN$|MIN_PART|MAX_WINDOWS|MIN_MEMORY"
)
Judgement = dict[str, Any]  # verdicts, flags and facts by name, or uncertainties and causes


@dataclass(frozen=True, eq=False)
class Constant:
    """A threshold, and the module that defines it."""

    module: ModuleType
    name: str
    value: Any

    def __str__(self) -> str:
        return f"{self.module.__name__.rpartition('.')[2]}.{self.name.strip('_').lower()}"


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


def modules() -> list[ModuleType]:
    """Return every module of the packages that judge."""
    packages = [import_module(name) for name in make_thresholds.PACKAGES]
    names = [
        info.name for package in packages for info in pkgutil.walk_packages(package.__path__, f"{package.__name__}.")
    ]
    return [*packages, *(import_module(name) for name in names)]


def constants(judging: Sequence[ModuleType]) -> Iterator[Constant]:
    """Yield the thresholds without laws, numerics and those of records."""
    by_name = {(module.__name__.partition(".")[0], module.__name__.rpartition(".")[2]): module for module in judging}
    for package in make_thresholds.PACKAGES:
        for row in make_thresholds.thresholds(package):
            for name in row.constants if row.origin != "law" and row.module not in _RECORDS else ():
                if not _NUMERICS.search(name):
                    module = by_name[package.partition(".")[0], row.module]
                    yield Constant(module, name, getattr(module, name))


def scaled(value: Any, factor: float) -> Any:
    """Return a threshold times a factor, of its own kind; odd windows stay odd, since they have a middle."""
    if isinstance(value, dict):
        return {key: scaled(number, factor) for key, number in value.items()}
    if isinstance(value, tuple):
        return tuple(scaled(number, factor) for number in value)
    if isinstance(value, int):
        return max(round(value * factor), 1) | value % 2
    if isinstance(value, float) and 0.9 <= value < 1.0:
        return 1.0 - (1.0 - value) * factor
    return value * factor if isinstance(value, float | np.ndarray) else value


@contextmanager
def replaced(group: Sequence[Constant], factor: float, judging: Sequence[ModuleType]) -> Iterator[None]:
    """Scale thresholds in every module that has imported them, and where they are the default of an argument."""
    functions = [each for module in judging for each in vars(module).values() if isinstance(each, FunctionType)]
    defaults = [(function, function.__defaults__) for function in functions if function.__defaults__]
    places: list[tuple[ModuleType, Constant]] = []
    for constant in group:
        users = [constant.module] if constant.name.startswith("_") else judging
        places += [(module, constant) for module in users if vars(module).get(constant.name) is constant.value]
    scales = {id(constant.value): scaled(constant.value, factor) for constant in group if type(constant.value) is float}
    try:
        for module, constant in places:
            setattr(module, constant.name, scaled(constant.value, factor))
        for function, values in defaults:
            function.__defaults__ = tuple(scales.get(id(value), value) for value in values)
        forget(judging)
        yield
    finally:
        for module, constant in places:
            setattr(module, constant.name, constant.value)
        for function, values in defaults:
            function.__defaults__ = values
        forget(judging)


def forget(judging: Sequence[ModuleType]) -> None:
    """Empty the caches of the modules."""
    for cached in [each for module in judging for each in vars(module).values() if hasattr(each, "cache_clear")]:
        cached.cache_clear()


def stored(judging: Sequence[ModuleType], folder: Path) -> Iterator[Record]:
    """Yield the records, each with the time that a judgement takes, and with all that it refers to."""
    for name, judge in stored_records(folder):
        begin = process_time()
        judgement = findings(judge())
        seconds = process_time() - begin
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
