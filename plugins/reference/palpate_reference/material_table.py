"""What an instrument measured of a material: moduli over frequency or time, creep, stress over strain."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from palpate import Floats, LogError

from palpate_reference.instrument_text import InstrumentText, read_text
from palpate_reference.table_blocks import TableBlock, table_blocks
from palpate_reference.table_columns import TableColumn, columns_of, demand_names, place, si_values

Kind = Literal["oscillation", "relaxation", "creep", "stress-strain"]
_NEEDS: Mapping[Kind, tuple[str, tuple[str, ...]]] = {
    "oscillation": ("frequency", ("storage", "loss")),
    "relaxation": ("time", ("modulus",)),
    "creep": ("time", ("compliance",)),
    "stress-strain": ("strain", ("stress",)),
}
_SAME = 0.02  # relative difference of frequencies of one line
_DECADE = 2e-3  # by which a frequency may miss a power of ten
_STRAINED = 3.0  # a strain that a solid does not reach


@dataclass(frozen=True)
class MaterialTable:
    """One table of a material [SI]."""

    source: str
    title: str
    format: str
    kind: Kind
    shear: bool  # moduli of shear; else of Young
    x: Floats  # (n,) [Hz], [s] or, of stress over strain, [1]
    y: Floats  # (n, 1 or 2) [Pa], of a creep [1/Pa]; storage and loss of an oscillation
    std: Floats | None  # (n, 1 or 2) standard uncertainties, where the table states them
    strain: Floats | None  # (n,) at which a modulus was measured
    temperature: Floats | None  # (n,) [°C]
    notes: tuple[str, ...] = ()

    @property
    def sweeps_frequency(self) -> bool:
        """Whether an oscillation has several frequencies."""
        return self.kind == "oscillation" and float(self.x.max()) > (1.0 + _SAME) * float(self.x.min())

    @property
    def name(self) -> str:
        """Source and title."""
        return f"{self.source}: {self.title}" if self.title else self.source


@dataclass(frozen=True)
class TableSettings:
    """What a person states about the tables of a file."""

    units: Mapping[str, str]  # by column
    shear: bool | None = None


def read_tables(path: Path, settings: TableSettings) -> list[MaterialTable]:
    """Every table of a file that holds moduli, a compliance, or stress over strain; raises LogError for none."""
    text = read_text(path)
    blocks = table_blocks(text)
    demand_names(text, {name for block in blocks for name in block.names}, settings.units)
    found: list[MaterialTable] = []
    for block in blocks:
        columns = columns_of(text, block, settings.units)
        kind = _kind(columns)
        if kind is not None:
            found.append(_table(text, block, columns, kind, settings))
    if not found:
        first = blocks[0]
        names = ", ".join(name for name in first.names if name)
        raise LogError(
            f"{path}:{first.names_line or first.rows[0].number if first.rows else 1}: no table of a material: it needs "
            "columns named frequency, G' and G''; time and relaxation modulus or creep compliance; or strain and "
            f"stress (there are: {names})"
        )
    return found


def _kind(columns: Mapping[str, TableColumn]) -> Kind | None:
    """What a table is by its columns; a flow curve is none of a solid."""
    frequency = columns.keys() & {"frequency", "angular_frequency"}
    time = columns.keys() & {"time", "step_time"}
    if frequency and {"storage", "loss"} <= columns.keys():
        return "oscillation"
    for kind in ("relaxation", "creep"):
        if time and _NEEDS[kind][1][0] in columns:
            return kind
    return "stress-strain" if {"strain", "stress"} <= columns.keys() and "flow" not in columns else None


def _table(
    text: InstrumentText, block: TableBlock, columns: dict[str, TableColumn], kind: Kind, settings: TableSettings
) -> MaterialTable:
    if not block.rows:
        raise LogError(f"{text.path}:{block.names_line}: the table has no rows")
    x, notes = _abscissa(text, block, columns, kind, settings)
    roles = _NEEDS[kind][1]
    y = np.column_stack([si_values(text, block, columns[role]) for role in roles])
    stds = [columns.get(f"{role}_std") for role in roles]
    std = np.column_stack([si_values(text, block, one) for one in stds if one]) if all(stds) else None
    others = {
        role: si_values(text, block, columns[role]) if role in columns and kind != "stress-strain" else None
        for role in ("strain", "temperature")
    }
    complete = np.isfinite(x) & np.isfinite(y).all(axis=1)
    if kind in ("relaxation", "creep"):
        complete &= x != 0.0  # a step has no answer yet
    if missing := int((~complete).sum()):
        notes.append(f"{missing} rows without all numbers are left out")
    if not complete.any():
        raise LogError(f"{place(text, block, columns[roles[0]])}: no row has all numbers")
    _demand_positive(text, block, columns, kind, x, y, std)
    if kind == "stress-strain" or (others["strain"] is not None and "strain" in columns):
        checked = x if kind == "stress-strain" else others["strain"]
        _ask_for_per_cent(text, block, columns["strain"], checked, settings)
    shear = _shear(text, block, columns[roles[0]], kind, settings)
    strain, temperature = (None if one is None else one[complete] for one in others.values())
    return MaterialTable(
        text.path.name, block.title, block.format, kind, shear, x[complete], y[complete],
        None if std is None else std[complete], strain, temperature, tuple(notes),
    )  # fmt: skip


def _abscissa(
    text: InstrumentText, block: TableBlock, columns: dict[str, TableColumn], kind: Kind, settings: TableSettings
) -> tuple[Floats, list[str]]:
    """Frequencies [Hz], times [s] or strains, and what is to be said of them."""
    if kind == "stress-strain":
        return si_values(text, block, columns["strain"]), []
    if kind != "oscillation":
        column = columns["step_time"] if "step_time" in columns else columns["time"]
        return si_values(text, block, column), []
    column = columns["frequency"] if "frequency" in columns else columns["angular_frequency"]
    x = si_values(text, block, column)
    if column.role == "angular_frequency":
        x = x / (2.0 * math.pi)
    elif "angular_frequency" in columns:
        _demand_same(text, block, column, x, si_values(text, block, columns["angular_frequency"]) / (2.0 * math.pi))
    if "viscosity" in columns and columns["viscosity"].index < min(len(line.cells) for line in block.rows):
        size = np.hypot(*(si_values(text, block, columns[role]) for role in ("storage", "loss")))
        by_viscosity = size / si_values(text, block, columns["viscosity"]) / (2.0 * math.pi)
        _demand_same(text, block, column, x, by_viscosity)
    if column.unit == "Hz" and column.name not in settings.units:
        _ask_for_radians(text, block, column, x)
    return x, ["frequency in rad/s, divided by 2 pi"] if column.unit != "Hz" else []


def _demand_same(text: InstrumentText, block: TableBlock, column: TableColumn, x: Floats, other: Floats) -> None:
    """Raise LogError where frequencies are not those that another column has."""
    ratio = float(np.nanmedian(other / x))
    if not math.isnan(ratio) and abs(ratio - 1.0) > _SAME:
        hint = " (2 pi: rad/s was taken for Hz, or the other way round)" if _is_turn(ratio) else ""
        raise LogError(
            f"{place(text, block, column)}: the frequency is {ratio:.4g} times that which the angular frequency or the "
            f'complex viscosity beside it states{hint}; state its unit with --unit "{column.name}=..."'
        )


def _is_turn(ratio: float) -> bool:
    return min(abs(ratio * 2 * math.pi - 1), abs(ratio / (2 * math.pi) - 1)) < _SAME


def _ask_for_radians(text: InstrumentText, block: TableBlock, column: TableColumn, x: Floats) -> None:
    """Raise LogError where frequencies in Hz are those of rad/s in round Hz, or Hz that are round in rad/s."""

    def decades(values: Floats) -> int:
        logs = np.log10(values[values > 0])
        return int((np.abs(logs - np.rint(logs)) < _DECADE).sum())

    if decades(x / (2 * math.pi)) >= 2 and not decades(x):
        row = int(np.argmin(np.abs(np.log10(x / (2 * math.pi)) - np.rint(np.log10(x / (2 * math.pi))))))
        raise LogError(
            f"{place(text, block, column, row)}: {x[row]:.5g} Hz is 2 pi times a power of ten, as are others: are they "
            f'rad/s? State which with --unit "{column.name}=rad/s" or "{column.name}=Hz"'
        )


def _demand_positive(
    text: InstrumentText,
    block: TableBlock,
    columns: dict[str, TableColumn],
    kind: Kind,
    x: Floats,
    y: Floats,
    std: Floats | None,
) -> None:
    """Raise LogError for a modulus, frequency, time or uncertainty that is not above zero, with line and column."""
    if kind == "stress-strain":
        return
    axis = next(columns[role] for role in ("step_time", "time", "frequency", "angular_frequency") if role in columns)
    if kind == "oscillation":
        axis = next(columns[role] for role in ("frequency", "angular_frequency") if role in columns)
    names = _NEEDS[kind][1]
    checked = [(axis, x if kind == "oscillation" else np.where(x == 0.0, 1.0, x))]
    checked += [(columns[role], y[:, k]) for k, role in enumerate(names)]
    checked += [(columns[f"{role}_std"], std[:, k]) for k, role in enumerate(names) if std is not None]
    for column, values in checked:
        wrong = np.flatnonzero(values <= 0.0)
        if len(wrong):
            raise LogError(
                f"{place(text, block, column, int(wrong[0]))}: {values[wrong[0]]:.4g} is not above zero, as it is for "
                f"every passive material; {len(wrong)} of {len(values)} rows: take them out, or check the export"
            )


def _ask_for_per_cent(
    text: InstrumentText, block: TableBlock, column: TableColumn, strain: Floats | None, settings: TableSettings
) -> None:
    """Raise LogError where a strain without per cent is larger than solids bear."""
    if strain is None or column.unit == "%" or column.name in settings.units:
        return
    largest = float(np.nanmax(np.abs(strain))) if np.isfinite(strain).any() else 0.0
    if largest > _STRAINED:
        row = int(np.nanargmax(np.abs(strain)))
        raise LogError(
            f"{place(text, block, column, row)}: a strain of {largest:.4g} is {100 * largest:.4g} %: is it in per "
            f'cent? State which with --unit "{column.name}=%" or "{column.name}=1"'
        )


def _shear(text: InstrumentText, block: TableBlock, column: TableColumn, kind: Kind, settings: TableSettings) -> bool:
    """Whether moduli are those of shear, as a person, the column, the file or its format says; raises LogError."""
    if kind == "stress-strain":
        return "shear" in column.name.lower()
    said = [settings.shear, column.shear, block.shear]
    shear = next((one for one in said if one is not None), None)
    if shear is None:
        sheared = any(name.lower().startswith(("shear strain", "shear stress")) for name in block.names)
        shear = True if sheared else None
    if shear is None:
        raise LogError(
            f"{place(text, block, column)}: of shear (a rheometer's G) or of tension and compression (a DMA's E)? "
            "State --modulus shear or --modulus young"
        )
    return shear


def frequency_or_time(kind: Kind) -> str:
    """The SI unit of the axis of a kind of table."""
    return {"oscillation": "Hz", "relaxation": "s", "creep": "s", "stress-strain": "1"}[kind]


def letters(table: MaterialTable) -> Sequence[str]:
    """What the columns of a table are called."""
    young = "G" if table.shear else "E"
    return {
        "oscillation": (f"{young}'", f"{young}''"),
        "relaxation": (f"{young}(t)",),
        "creep": ("J(t)" if table.shear else "D(t)",),
        "stress-strain": ("stress",),
    }[table.kind]
