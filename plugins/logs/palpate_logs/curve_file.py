"""Files of force curves: one curve, or a map of them, each of which is read by itself."""

from __future__ import annotations

import logging
import os
import warnings
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np
from palpate import LogError
from palpate_records.log_files import regular

from palpate_logs.curve_export import HDF5
from palpate_logs.force_curve import BEFORE, FORCE, REST, WAY_IN, WAY_OUT, ForceCurve, positive
from palpate_logs.jpk_curves import SUFFIXES as JPK, jpk_file

_Loaded = TypeVar("_Loaded")

_FILES = 4  # that stay open
_WAYS = {  # by afmformats' imaging mode: what each number of a segment is
    "creep-compliance": (WAY_IN, REST, WAY_OUT),
    "stress-relaxation": (BEFORE, WAY_IN, REST, WAY_OUT),
}
_KNOWN_MODES = "creep-compliance, force-distance, stress-relaxation"


class CurveFile(Protocol):
    """An open file of curves."""

    @property
    def format(self) -> str:
        """The maker's name of the format."""
        ...

    @property
    def numbers(self) -> tuple[int, ...]:
        """Numbers of the curves, ascending."""
        ...

    def curve(self, number: int) -> ForceCurve:
        """Return a curve; raises LogError where it is damaged."""
        ...

    def place(self, number: int) -> tuple[float, float] | None:
        """Return x and y [m] of a curve of a map; None where its file does not state them."""
        ...


def curve_file(path: Path) -> CurveFile:
    """Return an open file of curves; raises LogError where afmformats is missing or does not read it."""
    state = regular(path).stat()
    file = _open(path, state.st_mtime_ns, state.st_size, os.getpid())
    if not file.numbers:
        raise LogError(f"{path}: contains no force curve")
    return file


def named_curve(file: CurveFile, path: Path, name: str | None) -> ForceCurve:
    """Return the curve of a name, its number; without one the first. Raises LogError."""
    numbers = file.numbers
    if name is None:
        return file.curve(numbers[0])
    if not name.isdecimal() or int(name) not in numbers:
        raise LogError(f"{path}: no curve {name}; it contains {len(numbers)}, {numbers[0]} to {numbers[-1]}")
    return file.curve(int(name))


@lru_cache(_FILES)
def _open(path: Path, changed: int, size: int, process: int) -> CurveFile:
    """Return a file as it was at that instant, open in this process: a forked one would share its place in the file."""
    name = path.name.lower()
    if name.endswith(JPK):
        return jpk_file(path)
    if name.endswith(HDF5):
        return _hdf5_file(path)
    return _LoadedCurves(path, tuple(_loaded(path)))


@dataclass(frozen=True)
class _LoadedCurves:
    """The curves of a file that afmformats reads as a whole."""

    path: Path
    data: tuple[Any, ...]

    @property
    def format(self) -> str:
        return str(self.data[0].metadata.get("format", "force curve"))

    @property
    def numbers(self) -> tuple[int, ...]:
        return tuple(range(len(self.data)))

    def curve(self, number: int) -> ForceCurve:
        return _curve_of(self.data[number], str(self.path))

    def place(self, number: int) -> tuple[float, float] | None:
        return _place_of(self.data[number].metadata)


@dataclass(frozen=True)
class _ExportedCurves:
    """The curves of an HDF5 file of afmformats: a group for each."""

    path: Path
    numbers: tuple[int, ...]

    @property
    def format(self) -> str:
        return "afmformats (HDF5-based)"

    def curve(self, number: int) -> ForceCurve:
        def load(afmformats: Any) -> ForceCurve:
            from afmformats.formats import default_data_classes_by_modality as classes
            from afmformats.formats.fmt_hdf5 import H5DictReader

            facts = {**self._facts(number), "path": self.path, "enum": number}
            mode = facts.get("imaging mode")
            if mode not in classes:
                raise LogError(f"{name}: states the imaging mode {mode!r}; known are {_KNOWN_MODES}")
            return _curve_of(classes[mode](H5DictReader(self.path, str(number)), facts), name)

        name = f"{self.path}: curve {number}" if len(self.numbers) > 1 else str(self.path)
        return _by_afmformats(name, load)

    def place(self, number: int) -> tuple[float, float] | None:
        return _place_of(self._facts(number))

    def _facts(self, number: int) -> dict[str, Any]:
        """Return what is stated of a curve."""
        import h5py  # type: ignore[import-not-found,import-untyped,unused-ignore]

        with h5py.File(self.path, "r") as file:
            return dict(file[str(number)].attrs)


def _hdf5_file(path: Path) -> CurveFile:
    """Return an HDF5 file of afmformats; raises LogError."""

    def load(afmformats: Any) -> CurveFile:
        import h5py

        with closing(h5py.File(path, "r")) as file:
            if "software version" not in file.attrs:
                raise LogError(f"{path}: is not a force curve that afmformats knows: export it as text")
            names = map(str, file)
            return _ExportedCurves(path, tuple(sorted(int(name) for name in names if name.isdecimal())))

    return _by_afmformats(str(path), load)


def _loaded(path: Path) -> list[Any]:
    """Return every curve of a file by afmformats; raises LogError."""
    return _by_afmformats(str(path), lambda afmformats: list(afmformats.load_data(path)))


def _by_afmformats(name: str, load: Callable[[Any], _Loaded]) -> _Loaded:
    """Return what is loaded by afmformats; raises LogError where it is missing, or does not read the file."""
    try:
        with warnings.catch_warnings():  # of its own dependencies; what matters is raised
            warnings.simplefilter("ignore")
            import afmformats

            logging.getLogger("afmformats").addHandler(logging.NullHandler())  # which else prints a traceback
    except ImportError as error:
        raise LogError(f"{name}: force curves need afmformats: pip install 'palpate[afm]'") from error
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return load(afmformats)
    except (LogError, KeyboardInterrupt, SystemExit, MemoryError):
        raise
    except BaseException as error:  # of a parser, for files that are damaged; its own derive from nothing narrower
        if type(error).__name__ == "FileFormatNotSupportedError":
            raise LogError(f"{name}: is not a force curve that afmformats knows: export it as text") from error
        raise LogError(f"{name}: cannot be read as a force curve: {type(error).__name__}: {error}") from error


def _curve_of(data: Any, name: str) -> ForceCurve:
    """Return a curve of afmformats; raises LogError without a force."""
    columns, facts = tuple(data.columns), data.metadata
    if FORCE not in columns:
        raise LogError(f"{name}: contains no force (there are: {', '.join(columns)})")
    ways = _WAYS.get(str(facts.get("imaging mode")), (WAY_IN, WAY_OUT))
    spring, duration = (positive(facts.get(key, None)) for key in ("spring constant", "duration approach"))
    return ForceCurve(name, columns, data.__getitem__, ways, spring, duration)


def _place_of(facts: Mapping[str, Any]) -> tuple[float, float] | None:
    """Return x and y [m] that are stated of a curve; None where one is missing."""
    place = [facts.get(f"position {axis}") for axis in "xy"]
    if any(number is None for number in place):
        return None
    x, y = (float(number) for number in place if number is not None)
    return (x, y) if np.isfinite([x, y]).all() else None
