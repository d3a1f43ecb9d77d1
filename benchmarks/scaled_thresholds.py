"""The constants of the page of thresholds in the loaded modules, and how they are scaled there for a while."""

from __future__ import annotations

import pkgutil
import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "docs"))
import make_thresholds

_COMPLEMENTS = 0.9  # a share from here to 1 is scaled by its distance from 1
_RECORDS = ("sample_keeper", "result_folder")
_NUMERICS = re.compile(
    r"SMALLEST|_STEP$|^_?DIFFERENCE$|_DIFFERENCE$(?<!BIC_DIFFERENCE)|EVALUATIONS|ROUNDING|_UNIT$|CACHED|MIN_GAIN"
    r"|BOUND_MARGIN|SURFACE_SCALE|_SPAN$|MIN_PART|MAX_WINDOWS|MIN_MEMORY"
)


@dataclass(frozen=True, eq=False)
class Constant:
    """A threshold, and the module that defines it."""

    module: ModuleType
    name: str
    value: Any

    def __str__(self) -> str:
        return f"{self.module.__name__.rpartition('.')[2]}.{self.name.strip('_').lower()}"


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
    if isinstance(value, float) and _COMPLEMENTS <= value < 1.0:
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
