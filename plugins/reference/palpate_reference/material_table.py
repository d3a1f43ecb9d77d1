"""A table that an instrument measured of a material: moduli over frequency or time, creep, stress over strain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from palpate import Floats

Kind = Literal["oscillation", "relaxation", "creep", "stress-strain"]
_FREQUENCY_TOLERANCE = 0.02  # relative, a choice: frequencies that differ by less are one


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
        """True if an oscillation has several frequencies."""
        return self.kind == "oscillation" and float(self.x.max()) > (1.0 + _FREQUENCY_TOLERANCE) * float(self.x.min())

    @property
    def name(self) -> str:
        """Source and title."""
        return f"{self.source}: {self.title}" if self.title else self.source


@dataclass(frozen=True)
class TableSettings:
    """Statements of a person about the tables of a file."""

    units: Mapping[str, str]  # by name of a column
    shear: bool | None = None  # True: moduli are of shear, False: Young's; None: not stated
    columns: Mapping[str, str] = field(default_factory=dict)  # names of columns, by role


def frequency_or_time(kind: Kind) -> str:
    """Return the SI unit of the axis of a kind of table."""
    return {"oscillation": "Hz", "relaxation": "s", "creep": "s", "stress-strain": "1"}[kind]


def letters(table: MaterialTable) -> Sequence[str]:
    """Return the symbols of the values of a table."""
    young = "G" if table.shear else "E"
    return {
        "oscillation": (f"{young}'", f"{young}''"),
        "relaxation": (f"{young}(t)",),
        "creep": ("J(t)" if table.shear else "D(t)",),
        "stress-strain": ("stress",),
    }[table.kind]
