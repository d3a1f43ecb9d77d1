"""The keys of a CSV log: its columns, and the form in which its numbers are written."""

from __future__ import annotations

import codecs
from collections.abc import Mapping
from dataclasses import dataclass, field
from encodings.aliases import aliases
from functools import cached_property
from typing import Annotated, Literal, Self

from palpate import Channel, File, Frequency, Settings, Stream, Time, suggest, to_si
from palpate_kit.logs.log_link import file_facts
from palpate_records.log_files import regular
from palpate_records.messages.readings import si_unit
from palpate_records.recording import Recording
from palpate_records.tables.clock_times import CLOCK
from palpate_records.tables.csv_sheet import KEYS
from palpate_records.tables.dialect import Dialect
from palpate_records.tables.footer import event_words, footer_words
from pydantic import Field, model_validator


class Column(Settings):
    """One column of the file."""

    column: Annotated[int, Field(ge=0)] | Annotated[str, Field(min_length=1)] = Field(
        description="column: counted from 0, or its name in the header line"
    )
    unit: str = Field(min_length=1, description='unit of its numbers, such as "mm" or "N"; "clock" for times of day')
    scale: float = Field(default=1.0, description="how many of the unit one of its numbers is, for volts and counts")


class TimeOfRows(Column):
    """The column of the time."""

    nanoseconds: Annotated[int, Field(ge=0)] | Annotated[str, Field(min_length=1)] | None = Field(
        default=None, description="column of what is between the seconds, of a stamp in two columns [ns]"
    )


@dataclass
class Tally:
    """The rows, cells and lines of a file that are not read as readings."""

    timeless: int = 0  # rows without a finite time
    overload: int = 0  # cells with a mark of the instrument's overload
    footer: list[list[str]] = field(default_factory=list)  # cells of the lines below the readings
    held: dict[str, int] = field(default_factory=dict)  # by channel that repeats its readings: rows per reading
    events: list[str] = field(default_factory=list)  # lines of words between the readings
    cut: str | None = None  # the last number, if the file ends within it


class CsvSettings(Recording):
    """Keys, channels and provenance of a table of numbers."""

    file: File = Field(
        description="the log, a text, .gz, .xlsx, .npz, .mat, .h5, .parquet or .json, relative to the pipeline file"
    )
    columns: dict[str, Column] = Field(min_length=1, description="channels by name: { column = 0, unit = 'mm' }")
    rate: Frequency | None = Field(default=None, gt=0, description="sampling rate, where no column is the time")
    time: TimeOfRows | None = Field(default=None, description="the column of the time: { column = 0, unit = 's' }")
    delimiter: str = Field(
        default=",", min_length=1, max_length=1, description='separator of the columns: ",", ";", "\\t", " "'
    )
    decimal: Literal[".", ","] = Field(default=".", description="mark before the decimals")
    thousands: Literal["", ",", ".", " ", "'"] = Field(default="", description="mark between thousands")
    comment: str = Field(default="#", max_length=2, description='how a line begins that is a comment: "#", "%", "//"')
    encoding: str | None = Field(
        default=None, description='such as "utf-8", "utf-16" or "cp1252"; found in the file if left out'
    )
    header: int | None = Field(
        default=None, ge=0, description="line of the names, counted from 1, 0 for none; found if left out"
    )
    units: int | None = Field(
        default=None, ge=0, description="line of units that must agree with the columns', 0 for none; found if left out"
    )
    sheet: str | None = Field(default=None, description="of a workbook; the first with rows of numbers if left out")
    record: str | None = Field(
        default=None,
        min_length=1,
        description="of a file of several: a sheet, the title of a table or of columns, or the text in the column that "
        "names them",
    )

    begin: Time | None = Field(
        default=None, ge=0, description="leave out what was recorded earlier, counted from the first row"
    )
    end: Time | None = Field(default=None, gt=0, description="leave out what was recorded later")

    @model_validator(mode="after")
    def _validate_keys(self) -> Self:
        """Raise ValueError for keys that contradict each other, an unknown unit and an unknown encoding."""
        if (self.rate is None) == (self.time is None):
            raise ValueError('give either rate = "500 Hz" or time = { column = 0, unit = "s" }')
        if self.time is not None and self.time.unit != CLOCK:
            to_si(f"1 {self.time.unit}", "s")  # raises ValueError for a unit of another quantity
        if self.decimal == self.thousands:
            raise ValueError(f"thousands = {self.thousands!r} is the mark before the decimals")
        if self.encoding is not None:
            _demand_encoding(self.encoding)
        for column in self.columns.values():
            si_unit(column.unit)  # raises ValueError for an unknown unit
        return self

    @property
    def dialect(self) -> Dialect:
        """The dialect of the file: separator, marks of numbers and comments."""
        return Dialect(self.delimiter, self.decimal, self.thousands, self.comment)

    @property
    def written(self) -> dict[str, str]:
        """The stated keys on the form of the file, as texts."""
        return {key: str(value) for key in KEYS if (value := getattr(self, key)) is not None}

    @property
    def streams(self) -> tuple[Stream, ...]:
        """The only stream, which has no name: its channels are addressed as ``device.channel``."""
        regular(self.file)
        channels = tuple(Channel(name, si_unit(column.unit)[0]) for name, column in self.columns.items())
        return (Stream("", channels, self.rate, clock="file"),)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Rows without a time, readings that are missing, words between and below the rows, a last row that was cut."""
        tally = self.tally
        warnings: list[str] = []
        if tally.timeless:
            warnings.append(f"{tally.timeless} rows have no finite time, and were left out")
        if tally.overload:
            warnings.append(f"{tally.overload} cells hold a mark of overload, and no reading")
        if tally.events:
            warnings.append(event_words(tally.events))
        if tally.footer:
            warnings.append(footer_words(tally.footer))
        for channel, rows in tally.held.items():
            warnings.append(f"{channel} has a new reading in every {rows} rows; its repeats were left out")
        if tally.cut is not None:
            warnings.append(
                f"the last line has no end, and its last number, {tally.cut}, fewer digits than all "
                "above: it was cut and is left out"
            )
        return tuple(f"{self.file.name}: {warning}" for warning in warnings)

    @cached_property
    def tally(self) -> Tally:
        """The counts of what is left out, made while the file is read."""
        return Tally()

    @property
    def provenance(self) -> Mapping[str, str]:
        """The file and its SHA-256."""
        return file_facts(self.file, [self.file])


def _demand_encoding(name: str) -> None:
    """Raise ValueError for the name of an encoding that Python does not know; the message has the nearest name."""
    try:
        codecs.lookup(name)
    except LookupError as error:
        encodings = sorted({alias.replace("_", "-") for alias in aliases.values()})
        raise ValueError(f"encoding = {name!r}: no such encoding{suggest(name, encodings)}") from error
