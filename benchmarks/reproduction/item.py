"""One table or figure of the paper as settings: what is published, from which recording, by which pipeline."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from decimal import Decimal
from pathlib import Path
from typing import Any, Literal, Self, TypeVar

from palpate import ConfigurationError, suggest
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

HERE = Path(__file__).parent

T = TypeVar("T", bound=BaseModel)
Source = Literal["recording", "simulated", "arithmetic"]


class _Strict(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class AuthorsRecording(_Strict):
    """A public file of the paper's authors, and what is known of the delays that it does not state.

    Delays that were chosen since the published numbers come out with them are `fitted`. Only rows that are fitted, too,
    use those; the others have the delay that the record `delay_of` shows.
    """

    repository: str
    commit: str
    path: str
    bytes: int
    sha256: str = Field(pattern="^[0-9a-f]{64}$")
    motion_delay: str = "0 ms"
    force_delay: str = "0 ms"
    fitted: bool = False
    delay_of: str = ""  # name of a recording of the same kind
    reason: str  # for the delays

    @model_validator(mode="after")
    def _told(self) -> Self:
        if self.fitted and not self.delay_of:
            raise ValueError("delays that were fitted to the paper need delay_of, a recording that shows one")
        return self

    @property
    def url(self) -> str:
        """Where a person gets it."""
        return f"https://raw.githubusercontent.com/{self.repository}/{self.commit}/{self.path}"


class PublishedNumber(_Strict):
    """One number of the paper, and how it is reproduced."""

    row: str  # what it is of, such as "S2, R 5 mm"
    quantity: str  # parameter of the model, or: rss, rms, nis, lumps
    unit: str = ""  # as published; SI where left out
    value: Decimal  # with the digits that are printed
    spread: float | None = None  # standard uncertainty as published
    source: Source = "recording"
    fitted: str = ""  # which constant was chosen so that this number comes out
    shown: str = ""  # why it is shown, and not judged
    known: str = ""  # of the reason, where it is outside
    pipeline: str = ""  # file in pipelines/
    recording: str = ""  # name in recordings.toml
    track: str = ""
    set: Mapping[str, str | float | int | bool | list[str | float]] = {}
    formula: str = ""  # of arithmetic, with the names of `given`
    given: Mapping[str, Decimal] = {}

    @property
    def number(self) -> float:
        """The published value."""
        return float(self.value)

    @property
    def possible(self) -> bool:
        """Whether a public recording can say that it is reproduced."""
        return self.source == "recording" and not self.fitted and not self.shown

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if self.source == "arithmetic":
            if not self.formula:
                raise ValueError("arithmetic needs a formula")
        elif not self.pipeline or not self.track:
            raise ValueError(f"a row from a {self.source} needs pipeline and track")
        if (self.source == "recording") != bool(self.recording):
            raise ValueError('recording = NAME belongs to source = "recording", and to no other')
        return self


class MissingNumber(_Strict):
    """What of a table or figure cannot be reproduced, and why."""

    what: str
    reason: str
    numbers: int = 0  # how many it is


class Item(_Strict):
    """A table or figure."""

    label: str  # in the paper's source
    title: str
    note: str = ""
    published: tuple[PublishedNumber, ...] = ()
    missing: tuple[MissingNumber, ...] = ()

    @property
    def name(self) -> str:
        """The label without its kind: tab:visc_silic is visc_silic."""
        return self.label.partition(":")[2] or self.label


def half_digit(value: Decimal) -> float:
    """Half of the last digit that is printed."""
    exponent = value.as_tuple().exponent
    return 0.5 * 10.0**exponent if isinstance(exponent, int) else math.nan


def load_items(paper: Path, names: Sequence[str] = ()) -> list[Item]:
    """All items of a paper's folder, or those of some names or labels, in its order; raises ConfigurationError."""
    items = [_read(path, Item) for path in sorted((paper / "items").glob("*.toml"))]
    if not items:
        raise ConfigurationError(f"{paper}: has no items/*.toml, so it is not the folder of a paper")
    known = {name: item for item in items for name in (item.name, item.label)}
    for name in names:
        if name not in known:
            raise ConfigurationError(f"no item {name!r}{suggest(name, [item.name for item in items])}")
    return [item for item in items if not names or {item.name, item.label} & set(names)]


def load_recordings(paper: Path) -> dict[str, AuthorsRecording]:
    """The recordings that items may ask for, by name; raises ConfigurationError."""
    path = paper / "recordings.toml"
    tables = _tables(path) if path.is_file() else {}
    return {name: _checked(path, AuthorsRecording, table) for name, table in tables.items()}


def check_recordings(items: Sequence[Item], recordings: Mapping[str, AuthorsRecording]) -> None:
    """Raise ConfigurationError where a recording is not described, and where two rows are one number."""
    for owner, name in [(name, recording.delay_of) for name, recording in recordings.items()] + [
        (item.label, row.recording) for item in items for row in item.published
    ]:
        if name and name not in recordings:
            raise ConfigurationError(f"{owner}: no recording {name!r}{suggest(name, recordings)}")
    seen: dict[str, str] = {}
    for item in items:
        for row in item.published:
            where = f"{item.label}: {row.row}, {row.quantity}"
            key = row.model_dump_json(include={"quantity", "source", "fitted", "pipeline", "recording", "track", "set"})
            if row.possible and seen.setdefault(key, where) != where:
                raise ConfigurationError(f"{where}: is the same number as {seen[key]}")


def _read(path: Path, kind: type[T]) -> T:
    return _checked(path, kind, _tables(path))


def _tables(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text("utf-8"), parse_float=Decimal)
    except (tomllib.TOMLDecodeError, OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{path}: {error}") from error


def _checked(path: Path, kind: type[T], table: object) -> T:
    try:
        return kind.model_validate(table)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise ConfigurationError(f"{path}: {where}: {first['msg']}") from error
