"""Records: readings, and what is declared of them."""

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
_ROLES = {"height": "position", "x": "lateral_x", "y": "lateral_y"}  # by column, where it is called otherwise
LONG_INTERVAL = 0.5  # [s] between readings; sensors of force read far more often, and 2 ms read as 2 s
_SIGNALS = ("force", "height", "velocity")


@with_suggestions
@dataclass(frozen=True)
class Record:
    """Readings and what is declared of them: everything of a pipeline that does not concern model and estimator."""

    name: str
    devices: Mapping[str, Any]  # tables by name, as in a pipeline file
    alignment: Mapping[str, Any]  # the table, as in a pipeline file
    path: Path = Path("record")  # of a log; what messages call it
    doubts: tuple[str, ...] = ()  # what was guessed
    columns: NamedColumns | None = field(default=None, repr=False)  # of a record in memory
    assumed: tuple[str, ...] = ()  # keys such as "alignment.force.delay" that are not stated
    facts: StatedFacts | None = field(default=None, repr=False)  # of rig.toml and curves.csv next to its file

    @property
    def samples(self) -> xarray.Dataset:
        """What the readings become before any model: aligned, tared; dimension time, units in the attributes."""
        from palpate_notebook.datasets import samples_dataset

        return samples_dataset(self._aligned)

    @property
    def readings(self) -> dict[str, Batch]:
        """The readings as the devices send them, by "device.stream"; of a record that the alignment refuses, too."""
        from palpate_notebook.record_readings import readings_of

        return readings_of(source_of(self.name, self.path, {"device": dict(self.devices)}))

    def plot(self) -> Picture:
        """Force, height and velocity over time."""
        from palpate_notebook.plotting import samples_picture

        return samples_picture(self._aligned, self.name)

    @property
    def _aligned(self) -> Samples:
        from palpate_notebook.record_readings import samples_of

        tables = {"device": dict(self.devices), "alignment": dict(self.alignment)}
        source = source_of(self.name, self.path, tables)
        for assignment in self.facts.overrides if self.facts is not None else ():
            source.override(assignment)
        return samples_of(source)

    @property
    def _size(self) -> str:
        if self.columns is None:
            return ""
        span = float(self.columns.time[-1] - self.columns.time[0]) * 1e-9
        return f": {len(self.columns.time)} readings, {span:.4g} s"

    def __repr__(self) -> str:
        declared = ", ".join(f"{key} {value}" for key, value in self.alignment.items() if not isinstance(value, dict))
        doubts = "".join(f"\n  check: {text}" for text in self.doubts)
        facts = "" if self.facts is None else "".join(f"\n  {text}" for text in self.facts.origins)
        return f"<Record {self.name}{self._size}; {declared or 'nothing declared'}>{facts}{doubts}"

    def _repr_html_(self) -> str:
        """What is read from where, what is declared, and what was guessed."""
        rows = [[key, _told(value)] for key, value in self.alignment.items()]
        doubts = "".join(f"<li>check: {escape(printable(text))}</li>" for text in self.doubts)
        title = f"<b>{escape(printable(self.name))}</b>{escape(self._size)}"
        return f"{title}{html_table(['alignment', ''], rows)}{f'<ul>{doubts}</ul>' if doubts else ''}"


def _told(value: object) -> str:
    """Return a setting of the alignment; of a signal its channel first, then its keys."""
    if not isinstance(value, Mapping):
        return printable(str(value))
    others = (f"{key} {item}" for key, item in value.items() if key != "channel")
    return printable(", ".join([str(value.get("channel", "")), *others]).removeprefix(", "))


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
    given = {"force": force, "height": height, "velocity": velocity, "x": x, "y": y, "measuring": measuring}
    columns = _columns(given, units or {})
    stamped = _stamps(time, rate, columns, (units or {}).get("time"))
    _demand_equal_lengths({"time": len(stamped), **{key: len(column) for key, column in columns.items()}})
    doubts = _doubts(stamped)
    for text in doubts:
        warnings.warn(f"{name}: {text}", stacklevel=3)
    names = tuple((key, _UNITS[key]) for key in columns)
    digest, kept = register_readings(NamedColumns(stamped, np.column_stack(list(columns.values())), names))
    table = alignment_table(
        {_ROLES.get(key, key): f"record.{key}" for key in columns}, timing, delay, sign, tip_mass, tare, alignment
    )
    return Record(name, {"record": {"type": "memory-record", "sha256": digest}}, table, doubts=doubts, columns=kept)


def _columns(given: Mapping[str, ArrayLike | None], units: Mapping[str, str]) -> dict[str, Floats]:
    """Numbers (n,) [SI] of the columns that are given; raises ConfigurationError for anything else."""
    for key in units.keys() - {*given, "time"}:
        raise ConfigurationError(f"units: no column {key!r}{suggest(key, [*given, 'time'])}")
    there = {key: value for key, value in given.items() if value is not None}
    return {key: numbers(key, value, _UNITS[key], units.get(key)) for key, value in there.items()}


def _demand_equal_lengths(lengths: Mapping[str, int]) -> None:
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{key} has {length}" for key, length in lengths.items())
        raise ConfigurationError(f"the columns of a record must be equally long: {listed}")
    if lengths["time"] < 2:
        raise ConfigurationError(f"a record of {lengths['time']} readings is too short")


def _doubts(stamped: NDArray[np.int64]) -> tuple[str, ...]:
    """Return what is not certain of time-stamps (n,) [ns]; raises ConfigurationError for those that run backwards."""
    steps = np.diff(stamped)
    if (steps < 0).all():
        raise ConfigurationError("time: runs backwards from the first reading to the last; turn all columns round")
    if (steps < 0).any():
        raise ConfigurationError(f"time: runs backwards at reading {int(np.argmax(steps < 0)) + 1}; sort the readings")
    interval = 1e-9 * float(np.median(steps))
    if interval < LONG_INTERVAL:
        return ()
    return (f'time: a reading every {interval:.3g} s: is the time in ms? Then write units={{"time": "ms"}}',)


def _stamps(
    time: ArrayLike | None, rate: str | float | None, columns: Mapping[str, Floats], unit: str | None
) -> NDArray[np.int64]:
    if (time is None) == (rate is None):
        raise ConfigurationError('give either time=, in seconds, or rate="500 Hz"')
    if time is not None:
        return stamps(time, unit)
    try:
        hertz = to_si(rate, "Hz")
    except ValueError as error:
        raise ConfigurationError(f"rate: {error}") from error
    if hertz <= 0:
        raise ConfigurationError(f"rate: {rate!r} must be above 0")
    return np.asarray(np.rint(np.arange(len(columns["force"])) * (1e9 / hertz)).astype(np.int64))


def alignment_table(
    channels: Mapping[str, Any],
    timing: str | float | None,
    delay: str | float | Mapping[str, str | float] | None,
    sign: int | Mapping[str, int] | None,
    tip_mass: str | float | None,
    tare: str | float | None,
    alignment: Mapping[str, Any] | None,
) -> dict[str, Any]:
    """The table ``[alignment]`` from its channels by role and what is declared; a delay or sign alone is the force's.

    Raises ConfigurationError for an unknown signal.
    """
    table: dict[str, Any] = {
        role: {"channel": value} if isinstance(value, str) else dict(value) for role, value in channels.items()
    }
    for key, said in (("delay", delay), ("sign", sign)):
        every = said if isinstance(said, Mapping) else {} if said is None else {"force": said}
        for signal, value in every.items():
            role = _ROLES.get(signal, signal)
            if signal not in _SIGNALS or role not in table:
                raise ConfigurationError(f"{key}: no signal {signal!r}{suggest(signal, _SIGNALS)}")
            table[role][key] = value
    if timing is not None:
        table["force"]["uncertainty"] = timing
    if tip_mass is not None:
        table["tip_mass"] = tip_mass
    if tare is not None:
        table["tare"] = float(tare) if isinstance(tare, str) and is_number(tare) else tare
    return table | dict(alignment or {})
