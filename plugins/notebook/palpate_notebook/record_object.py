"""Records: readings with their declarations."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from palpate import Batch, ConfigurationError, Floats, Samples, is_number, printable, suggest, to_si

from palpate_notebook.argument_names import explains_arguments
from palpate_notebook.array_input import numbers, stamps
from palpate_notebook.html_table import html_table
from palpate_notebook.memory_device import NamedColumns, register_readings
from palpate_notebook.part_tables import source_of
from palpate_notebook.suggestions import with_suggestions

if TYPE_CHECKING:
    import xarray
    from palpate_kit.curves.stated_facts import StatedFacts

    from palpate_notebook.figure_object import Picture

_UNITS = {"force": "N", "height": "m", "velocity": "m/s", "x": "m", "y": "m", "measuring": "1"}
_ROLES = {"height": "position", "x": "lateral_x", "y": "lateral_y"}  # in [alignment], where a column has another name
LONG_INTERVAL = 0.5  # [s] between readings, a choice: force sensors are far faster; 2 ms taken as seconds are 2 s
_NANOSECOND = 1e-9  # [s]
_SECOND = 1e9  # [ns]
_SIGNALS = ("force", "height", "velocity")


@with_suggestions
@dataclass(frozen=True)
class Record:
    """Readings with their declarations: the tables of a pipeline that do not concern model and estimator."""

    name: str
    devices: Mapping[str, Any]  # tables by name, as in a pipeline file
    alignment: Mapping[str, Any]  # the table, as in a pipeline file
    path: Path = Path("record")  # of a log, as in messages
    doubts: tuple[str, ...] = ()  # sentences on guesses
    columns: NamedColumns | None = field(default=None, repr=False)  # of a record in memory
    assumed: tuple[str, ...] = ()  # keys such as "alignment.force.delay" that are not stated
    facts: StatedFacts | None = field(default=None, repr=False)  # of rig.toml and curves.csv next to its file

    @property
    def samples(self) -> xarray.Dataset:
        """The samples, aligned and tared, before any model; dimension time, units in the attributes."""
        from palpate_notebook.datasets import samples_dataset

        return samples_dataset(self._aligned)

    @property
    def readings(self) -> dict[str, Batch]:
        """The readings as the devices send them, by "device.stream", even of a record that the alignment refuses."""
        from palpate_notebook.record_readings import readings_of

        return readings_of(source_of(self.name, self.path, {"device": dict(self.devices)}))

    def plot(self) -> Picture:
        """Return a picture of force, height and velocity over time."""
        from palpate_notebook.plotting import samples_picture

        return samples_picture(self._aligned, self.name)

    @property
    def _aligned(self) -> Samples:
        """The samples by the tables of the record, and by the facts of files next to it."""
        from palpate_notebook.record_readings import samples_of

        tables = {"device": dict(self.devices), "alignment": dict(self.alignment)}
        source = source_of(self.name, self.path, tables)
        for assignment in self.facts.overrides if self.facts is not None else ():
            source.override(assignment)
        return samples_of(source)

    @property
    def _size(self) -> str:
        """Number of readings and duration in words; empty for a log."""
        if self.columns is None:
            return ""
        duration = float(self.columns.time[-1] - self.columns.time[0]) * _NANOSECOND
        return f": {len(self.columns.time)} readings, {duration:.4g} s"

    def __repr__(self) -> str:
        declared = ", ".join(f"{key} {value}" for key, value in self.alignment.items() if not isinstance(value, dict))
        doubts = "".join(f"\n  check: {doubt}" for doubt in self.doubts)
        facts = "" if self.facts is None else "".join(f"\n  {origin}" for origin in self.facts.origins)
        return f"<Record {self.name}{self._size}; {declared or 'nothing declared'}>{facts}{doubts}"

    def _repr_html_(self) -> str:
        """Return the table of the alignment and the doubts as HTML."""
        rows = [[key, _entry_text(entry)] for key, entry in self.alignment.items()]
        doubts = "".join(f"<li>check: {escape(printable(doubt))}</li>" for doubt in self.doubts)
        title = f"<b>{escape(printable(self.name))}</b>{escape(self._size)}"
        return f"{title}{html_table(['alignment', ''], rows)}{f'<ul>{doubts}</ul>' if doubts else ''}"


def _entry_text(entry: object) -> str:
    """Return an entry of the alignment as text; of a signal its channel first, then its other keys."""
    if not isinstance(entry, Mapping):
        return printable(str(entry))
    settings = (f"{key} {setting}" for key, setting in entry.items() if key != "channel")
    return printable(", ".join([str(entry.get("channel", "")), *settings]).removeprefix(", "))


@explains_arguments
def record(
    *,
    time: ArrayLike | None = None,
    rate: str | float | None = None,
    force: ArrayLike,
    height: ArrayLike,
    velocity: ArrayLike | None = None,
    x: ArrayLike | None = None,
    y: ArrayLike | None = None,
    measuring: ArrayLike | None = None,
    timing: str | float | None = None,
    delay: str | float | Mapping[str, str | float] | None = None,
    sign: int | Mapping[str, int] | None = None,
    tip_mass: str | float | None = None,
    tare: str | float = "free-air",
    units: Mapping[str, str] | None = None,
    alignment: Mapping[str, Any] | None = None,
    name: str = "record",
) -> Record:
    """Return a record from arrays (n,), pandas columns, xarray variables or pint quantities; plain numbers are SI.

    `time` [s], or dates, or a `rate` in its place; `force` [N], positive where the tip is pushed out; `height` [m],
    positive out of the material; `velocity` [m/s] of that height, left out: central difference of it; `x`, `y` [m]
    along the skin; `measuring`: where the motion is meant for estimation. `units` says what plain numbers are in:
    ``{"height": "mm"}``.

    Declared: `timing`, standard uncertainty between force and motion; `delay` of the force, or of each signal by name;
    `sign` -1 where the force, or a signal by name, counts the other way; `tip_mass` of all that hangs behind the sensor
    (0 where it is known to be nothing); `tare` as in ``[alignment]``: "free-air", "none" or a force. `alignment` takes
    any other key of that table. What is not declared is flagged in the results.

    Raises ConfigurationError for columns that do not fit together, or are not numbers.
    """
    arguments = {"force": force, "height": height, "velocity": velocity, "x": x, "y": y, "measuring": measuring}
    columns = _columns(arguments, units or {})
    time_stamps = _time_stamps(time, rate, columns, (units or {}).get("time"))
    _demand_equal_lengths({"time": len(time_stamps), **{key: len(column) for key, column in columns.items()}})
    doubts = _doubts(time_stamps)
    for doubt in doubts:
        warnings.warn(f"{name}: {doubt}", stacklevel=3)
    # The readings are kept in memory; the device of the record names them by their digest.
    channels = tuple((key, _UNITS[key]) for key in columns)
    digest, kept = register_readings(NamedColumns(time_stamps, np.column_stack(list(columns.values())), channels))
    table = alignment_table(
        {_ROLES.get(key, key): f"record.{key}" for key in columns}, timing, delay, sign, tip_mass, tare, alignment
    )
    return Record(name, {"record": {"type": "memory-record", "sha256": digest}}, table, doubts=doubts, columns=kept)


def _columns(arguments: Mapping[str, ArrayLike | None], units: Mapping[str, str]) -> dict[str, Floats]:
    """Return columns (n,) [SI] of the arguments that are not None; raises ConfigurationError for anything else."""
    for key in units.keys() - {*arguments, "time"}:
        raise ConfigurationError(f"units: no column {key!r}{suggest(key, [*arguments, 'time'])}")
    columns = {}
    for key, data in arguments.items():
        if data is not None:
            columns[key] = numbers(key, data, _UNITS[key], units.get(key))
    return columns


def _demand_equal_lengths(lengths: Mapping[str, int]) -> None:
    """Raise ConfigurationError for columns of different lengths, or of less than two readings."""
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{key} has {length}" for key, length in lengths.items())
        raise ConfigurationError(f"the columns of a record must be equally long: {listed}")
    if lengths["time"] < 2:
        raise ConfigurationError(f"a record of {lengths['time']} readings is too short")


def _doubts(time_stamps: NDArray[np.int64]) -> tuple[str, ...]:
    """Return sentences on doubtful time-stamps (n,) [ns]; raises ConfigurationError for those that run backwards."""
    steps = np.diff(time_stamps)
    if (steps < 0).all():
        raise ConfigurationError("time: runs backwards from the first reading to the last; turn all columns round")
    if (steps < 0).any():
        raise ConfigurationError(f"time: runs backwards at reading {int(np.argmax(steps < 0)) + 1}; sort the readings")
    interval = _NANOSECOND * float(np.median(steps))
    if interval < LONG_INTERVAL:
        return ()
    return (f'time: a reading every {interval:.3g} s: is the time in ms? Then write units={{"time": "ms"}}',)


def _time_stamps(
    time: ArrayLike | None, rate: str | float | None, columns: Mapping[str, Floats], unit: str | None
) -> NDArray[np.int64]:
    """Return time-stamps (n,) [ns] by a time, plain numbers in a unit (None: s), or by a rate; exactly one is given."""
    if (time is None) == (rate is None):
        raise ConfigurationError('give either time=, in seconds, or rate="500 Hz"')
    if time is not None:
        return stamps(time, unit)
    try:
        frequency = to_si(rate, "Hz")
    except ValueError as error:
        raise ConfigurationError(f"rate: {error}") from error
    if frequency <= 0:
        raise ConfigurationError(f"rate: {rate!r} must be above 0")
    return np.asarray(np.rint(np.arange(len(columns["force"])) * (_SECOND / frequency)).astype(np.int64))


def alignment_table(
    channels: Mapping[str, Any],
    timing: str | float | None,
    delay: str | float | Mapping[str, str | float] | None,
    sign: int | Mapping[str, int] | None,
    tip_mass: str | float | None,
    tare: str | float | None,
    alignment: Mapping[str, Any] | None,
) -> dict[str, Any]:
    """Return the table ``[alignment]`` of channels by role, and of the declarations in the arguments of `record`.

    A delay or sign that is not by signal is the force's. Raises ConfigurationError for an unknown signal.
    """
    table: dict[str, Any] = {}
    for role, channel in channels.items():
        table[role] = {"channel": channel} if isinstance(channel, str) else dict(channel)
    for key, declared in (("delay", delay), ("sign", sign)):
        if declared is None:
            continue
        by_signal = declared if isinstance(declared, Mapping) else {"force": declared}
        for signal, setting in by_signal.items():
            role = _ROLES.get(signal, signal)
            if signal not in _SIGNALS or role not in table:
                raise ConfigurationError(f"{key}: no signal {signal!r}{suggest(signal, _SIGNALS)}")
            table[role][key] = setting
    if timing is not None:
        table["force"]["uncertainty"] = timing
    if tip_mass is not None:
        table["tip_mass"] = tip_mass
    if tare is not None:
        table["tare"] = float(tare) if isinstance(tare, str) and is_number(tare) else tare
    return table | dict(alignment or {})
