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
from palpate_logs.force_curve import APPROACH, BEFORE_APPROACH, FORCE, PAUSE, RETRACT, ForceCurve, positive
from palpate_logs.jpk_curves import SUFFIXES as JPK, jpk_file

_LoadedObject = TypeVar("_LoadedObject")

_MAX_OPEN_FILES = 4  # a choice: the files of a few curves that are read in turns
_SEGMENT_KINDS = {  # by afmformats' imaging mode, in the order of its numbers of segments
    "creep-compliance": (APPROACH, PAUSE, RETRACT),
    "stress-relaxation": (BEFORE_APPROACH, APPROACH, PAUSE, RETRACT),
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
    status = regular(path).stat()
    file = _open_file(path, modified=status.st_mtime_ns, size=status.st_size, process=os.getpid())
    if not file.numbers:
        raise LogError(f"{path}: contains no force curve")
    return file


def named_curve(file: CurveFile, path: Path, name: str | None) -> ForceCurve:
    """Return the curve of a name, which is its number; the first one for None. Raises LogError."""
    numbers = file.numbers
    if name is None:
        return file.curve(numbers[0])
    if not name.isdecimal() or int(name) not in numbers:
        raise LogError(f"{path}: no curve {name}; it contains {len(numbers)}, {numbers[0]} to {numbers[-1]}")
    return file.curve(int(name))


@lru_cache(_MAX_OPEN_FILES)
def _open_file(path: Path, *, modified: int, size: int, process: int) -> CurveFile:
    """Return an open file of curves; one that is already open serves again.

    The time [ns] of its last change and its size [bytes] are arguments so that a changed file is opened again. So is
    the process: a fork would share the offset in the open file.
    """
    name = path.name.lower()
    if name.endswith(JPK):
        return jpk_file(path)
    if name.endswith(HDF5):
        return _hdf5_file(path)
    return _LoadedCurves(path, tuple(_load_curves(path)))


@dataclass(frozen=True)
class _LoadedCurves:
    """The curves of a file that afmformats reads as a whole."""

    path: Path
    curves: tuple[Any, ...]  # of afmformats

    @property
    def format(self) -> str:
        return str(self.curves[0].metadata.get("format", "force curve"))

    @property
    def numbers(self) -> tuple[int, ...]:
        return tuple(range(len(self.curves)))

    def curve(self, number: int) -> ForceCurve:
        return _force_curve(self.curves[number], str(self.path))

    def place(self, number: int) -> tuple[float, float] | None:
        return _stated_place(self.curves[number].metadata)


@dataclass(frozen=True)
class _ExportedCurves:
    """The curves of an HDF5 file of afmformats: a group for each."""

    path: Path
    numbers: tuple[int, ...]

    @property
    def format(self) -> str:
        return "afmformats (HDF5-based)"

    def curve(self, number: int) -> ForceCurve:
        def load_curve(afmformats: Any) -> ForceCurve:
            """Return the curve by the class of afmformats for its imaging mode."""
            from afmformats.formats import default_data_classes_by_modality as classes
            from afmformats.formats.fmt_hdf5 import H5DictReader

            facts = {**self._facts(number), "path": self.path, "enum": number}
            mode = facts.get("imaging mode")
            if mode not in classes:
                raise LogError(f"{name}: states the imaging mode {mode!r}; known are {_KNOWN_MODES}")
            return _force_curve(classes[mode](H5DictReader(self.path, str(number)), facts), name)

        name = f"{self.path}: curve {number}" if len(self.numbers) > 1 else str(self.path)
        return _load_by_afmformats(name, load_curve)

    def place(self, number: int) -> tuple[float, float] | None:
        return _stated_place(self._facts(number))

    def _facts(self, number: int) -> dict[str, Any]:
        """Return the attributes of the group of a curve, as the file states them."""
        import h5py  # type: ignore[import-not-found,import-untyped,unused-ignore]

        with h5py.File(self.path, "r") as file:
            return dict(file[str(number)].attrs)


def _hdf5_file(path: Path) -> CurveFile:
    """Return an HDF5 file of afmformats; raises LogError."""

    def load_file(afmformats: Any) -> CurveFile:
        """Return the numbers of the curves, which are the names of the groups."""
        import h5py

        with closing(h5py.File(path, "r")) as file:
            if "software version" not in file.attrs:
                raise LogError(f"{path}: is not a force curve that afmformats knows: export it as text")
            names = map(str, file)
            return _ExportedCurves(path, tuple(sorted(int(name) for name in names if name.isdecimal())))

    return _load_by_afmformats(str(path), load_file)


def _load_curves(path: Path) -> list[Any]:
    """Return every curve of a file by afmformats; raises LogError."""
    return _load_by_afmformats(str(path), lambda afmformats: list(afmformats.load_data(path)))


def _load_by_afmformats(name: str, load: Callable[[Any], _LoadedObject]) -> _LoadedObject:
    """Return the object that a function loads with the module afmformats.

    Raises LogError, with the name of the file or curve, if afmformats is not installed or does not read the file.
    """
    # Warnings of afmformats' dependencies are of no use to a person; a failure is raised.
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            import afmformats

            logging.getLogger("afmformats").addHandler(logging.NullHandler())  # without a handler it prints a traceback
    except ImportError as error:
        raise LogError(f"{name}: force curves need afmformats: pip install 'palpate[afm]'") from error
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return load(afmformats)
    except (LogError, KeyboardInterrupt, SystemExit, MemoryError):
        raise
    except BaseException as error:  # of a parser, for a damaged file: afmformats' errors derive from nothing narrower
        if type(error).__name__ == "FileFormatNotSupportedError":
            raise LogError(f"{name}: is not a force curve that afmformats knows: export it as text") from error
        raise LogError(f"{name}: cannot be read as a force curve: {type(error).__name__}: {error}") from error


def _force_curve(afm_curve: Any, name: str) -> ForceCurve:
    """Return a curve that afmformats has read, by a name for messages; raises LogError without a force."""
    columns = tuple(afm_curve.columns)
    facts = afm_curve.metadata
    if FORCE not in columns:
        raise LogError(f"{name}: contains no force (there are: {', '.join(columns)})")
    return ForceCurve(
        name,
        columns,
        read_column=afm_curve.__getitem__,
        segment_kinds=_SEGMENT_KINDS.get(str(facts.get("imaging mode")), (APPROACH, RETRACT)),
        spring_constant=positive(facts.get("spring constant", None)),
        approach_duration=positive(facts.get("duration approach", None)),
    )


def _stated_place(facts: Mapping[str, Any]) -> tuple[float, float] | None:
    """Return x and y [m] of a curve by the facts of its file; None if one is missing or not finite."""
    x, y = facts.get("position x"), facts.get("position y")
    if x is None or y is None:
        return None
    x, y = float(x), float(y)
    return (x, y) if np.isfinite([x, y]).all() else None
