"""What the columns of an instrument's table are: roles by their names, units, and numbers in SI."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from palpate import Floats, LogError, is_unit, suggest, to_si

from palpate_reference.instrument_text import InstrumentText
from palpate_reference.table_blocks import TableBlock

_LONGEST_NAME = 200  # characters of a name that may have a unit
_UNIT_BEHIND = re.compile(r"\s*[\[(]([^\])]*)[\])]\s*$")
_UNIT_NAMED = re.compile(r"\s+in\s+(\S+)$")  # as RheoWin writes it
_UNIT_IN_NAME = re.compile(r"_(per_)?(Pa|kPa|MPa|Hz|s|m)$")
_UNIT_OVER = re.compile(r"(.*?[^\s/,])\s*[/,]\s*([^\s/,]+(?:/[^\s/,]+)?)$")  # "G'/Pa", "omega / rad/s", "G', Pa"
_OF_TIME = re.compile(r"([GEJD])\(t\)|tan ?\((?:delta|δ)\)", re.IGNORECASE)  # brackets that hold no unit
_ALIASES = {"°": "deg", "º": "deg", "sec": "s", "Pa.s": "Pa*s", "Pa-s": "Pa*s", "-": "1", "": "", "rad/sec": "rad/s"}
# Role -> its SI unit, and the names by which programs call it, in small letters.
_ROLES: Mapping[str, tuple[str, str]] = {
    "frequency": ("Hz", r"freq(uency)?|f"),
    "angular_frequency": ("rad/s", r"ang(ular|\.)? ?freq(uency)?|omega|ω|w"),
    "storage": ("Pa", r"elastic component|"
                r"((?P<kind>shear|tensile|young'?s?|[ge]) )?storage( modulus)?|(?P<kind2>[ge])(?:'| stor)"),
    "loss": ("Pa", r"viscous component|((?P<kind>shear|tensile|young'?s?|[ge]) )?loss( modulus)?|(?P<kind2>[ge])''"),
    "loss_factor": ("", r"tan ?\(?(delta|δ|d)\)?|(loss|damping) (factor|tangent)"),
    "magnitude": ("Pa", r"((?P<kind>shear|tensile|young'?s?) )?(complex|dynamic) (shear )?modulus|"
                        r"\|?(?P<kind2>[ge])\*\|?|\|(?P<kind3>[ge])\|"),
    "phase": ("rad", r"delta|δ|(phase|loss)( (angle|shift|lag))|phase"),
    "modulus": ("Pa", r"((?P<kind>shear|tensile|young'?s?) )?relaxation modulus|(?P<kind2>[ge])(?:\(t\)| relax)?|"
                      r"modulus"),
    "compliance": ("1/Pa", r"((?P<kind>shear|tensile) )?(creep )?compliance|(?P<kind2>[jd])(?:\(t\))?"),
    "time": ("s", r"time|t"),
    "step_time": ("s", r"(step|interval) time"),
    "test_time": ("s", r"test time"),
    "strain": ("1", r"((oscillation|shear|axial|compressive|tensile|engineering|nominal) )?strain|amplitude"),
    "stress": ("Pa", r"((shear|axial|compressive|tensile|engineering|nominal) )?stress"),
    "temperature": ("°C", r"temp(erature)?"),
    "viscosity": ("Pa*s", r"(\|?eta\*\|?|complex viscosity|\|n\*\|)"),
    "flow": ("", r"shear rate|viscosity"),
}  # fmt: skip
_ZEROS = {"C": 0.0, "K": -273.15}  # [°C] of units of temperature
_STD = re.compile(r"(?:std|sd|u)[ (](.+)|(.+) (?:std|sd|error|uncertainty)")
_YOUNG = ("tensile", "young", "youngs", "young's", "e", "d")


@dataclass(frozen=True)
class TableColumn:
    """One column: what it is, and where it stands."""

    role: str
    index: int
    name: str
    unit: str  # as written; empty where none is
    shear: bool | None = None  # of a modulus: of shear, of Young, or not said
    std: bool = False  # whether it is the standard uncertainty of its role


def columns_of(
    text: InstrumentText, block: TableBlock, stated: Mapping[str, str], roles: Mapping[str, str] = {}
) -> dict[str, TableColumn]:
    """Columns by role, ``ROLE_std`` for uncertainties, with units and `roles` as the file or a person states them.

    Of a table that has moduli of shear and of Young those of shear. Raises LogError for a role that there is not.
    """
    if wrong := next((role for role in roles if role not in _ROLES), None):
        raise LogError(f"{text.path}: --column: no role {wrong!r}{suggest(wrong, _ROLES)}")
    role_of = {head: role for role, head in roles.items()}
    found: dict[str, TableColumn] = {}
    for index, head in enumerate(block.names):
        name, written = name_and_unit(head)
        if index < len(block.units) and block.units[index]:
            written = block.units[index]
        written = stated.get(head, stated.get(name, written))
        unit, chosen = _ALIASES.get(written, written), role_of.get(head, role_of.get(name))
        column = _column(index, head, name, unit) if chosen is None else TableColumn(chosen, index, head, unit)
        if column is None or (chosen is None and column.role in roles):
            continue
        key = f"{column.role}_std" if column.std else column.role
        if key not in found or (found[key].shear is False and column.shear):
            found[key] = column
    return found


def demand_names(text: InstrumentText, heads: set[str], option: str, stated: Iterable[str]) -> None:
    """Raise LogError where a person names a column that is in no table of the file."""
    names = {*heads, *(name_and_unit(head)[0] for head in heads)}
    for name in stated:
        if name not in names:
            raise LogError(f"{text.path}: {option}: no column {name!r}{suggest(name, {h for h in heads if h})}")


def name_and_unit(head: str) -> tuple[str, str]:
    """Return a name without its unit, and that.

    >>> name_and_unit("G' [kPa]"), name_and_unit("E_std_Pa"), name_and_unit("J_per_Pa"), name_and_unit("G(t) (Pa)")
    (("G'", 'kPa'), ('E std', 'Pa'), ('J', '1/Pa'), ('G(t)', 'Pa'))
    >>> name_and_unit("omega / rad/s"), name_and_unit("tan(delta)")
    (('omega', 'rad/s'), ('tan(delta)', ''))
    """
    head = head.strip()
    if len(head) > _LONGEST_NAME:  # the patterns below take the square of the time of a name's length
        return head, ""
    if match := _UNIT_IN_NAME.search(head):
        return head[: match.start()].replace("_", " "), f"1/{match[2]}" if match[1] else match[2]
    if (match := _UNIT_NAMED.search(head)) and (is_unit(match[1]) or match[1].startswith("°")):
        return head[: match.start()].strip(), match[1]
    match = None if _OF_TIME.fullmatch(head) else _UNIT_BEHIND.search(head)
    if match and (is_unit(match[1].strip()) or head[: match.start()].strip().lower() not in ("u", "std", "sd")):
        return head[: match.start()].strip().replace("_", " "), match[1].strip()
    if (match := _UNIT_OVER.fullmatch(head)) and is_unit(match[2]):
        return match[1].replace("_", " "), match[2]
    return head.replace("_", " "), ""


def _inside(name: str) -> str:
    """Return the name that stands in brackets, or none."""
    name = name.lstrip("( ")
    return name.removesuffix(")") if name.count(")") > name.count("(") else name


def _column(index: int, head: str, name: str, unit: str) -> TableColumn | None:
    plain = re.sub(r"[’′`´]", "'", name).replace("″", "''").replace('"', "''").strip()
    if plain == "T":
        return TableColumn("temperature", index, head, unit)
    plain = " ".join(plain.lower().split())
    match = _STD.fullmatch(plain)
    std = match is not None
    plain = _inside(match[1] or match[2]) if match else plain
    for role, (_, pattern) in _ROLES.items():
        if named := re.fullmatch(pattern, plain):
            groups = named.groupdict()
            kind = groups.get("kind") or groups.get("kind2") or groups.get("kind3")
            return TableColumn(role, index, head, unit, None if kind is None else kind not in _YOUNG, std)
    return None


def si_values(text: InstrumentText, block: TableBlock, column: TableColumn) -> Floats:
    """Return the numbers (n,) of a column in SI, NaN where a cell is empty; raises LogError with line and column."""
    factor, zero = _scale(text, block, column)
    values = np.empty(len(block.rows))
    for k, line in enumerate(block.rows):
        cell = line.cell(column.index)
        at = f"{text.path}:{line.number}, column {column.index + 1} {column.name!r}"
        if column.index >= len(line.cells):
            raise LogError(f"{at}: the line ends before it: the file is cut short, or its columns differ")
        if not cell:
            values[k] = math.nan
            continue
        if not text.is_number(cell):
            raise LogError(f"{at}: {cell[:40]!r} is not a number")
        values[k] = text.number(cell) * factor + zero
        if not math.isfinite(values[k]):
            raise LogError(f"{at}: {cell!r} is not a finite number; take the row out")
    return values


def _scale(text: InstrumentText, block: TableBlock, column: TableColumn) -> tuple[float, float]:
    """Return how much of the SI unit of its role one of a column's unit is, and what nought of it is; raises
    LogError."""
    if _ROLES[column.role][0] != "°C":
        return _factor(text, block, column), 0.0
    unit = column.unit.lstrip("°º \u02da\N{REPLACEMENT CHARACTER}").removeprefix("deg").strip() or "C"
    if unit not in _ZEROS:
        raise LogError(f"{place(text, block, column)}: a temperature is in °C or K, not in {column.unit!r}")
    return 1.0, _ZEROS[unit]


def _factor(text: InstrumentText, block: TableBlock, column: TableColumn) -> float:
    """Return how much of the SI unit of its role one of a column's unit is; raises LogError."""
    si = _ROLES[column.role][0]
    at = place(text, block, column)
    if not si:
        return 1.0
    if not column.unit:
        first, *others = example_unit(column.role)
        rest = "".join(f' or "{other}"' for other in others)
        raise LogError(f'{at}: has no unit: state it with --unit "{column.name}={first}"{rest}')
    if column.role == "angular_frequency" and column.unit == "Hz":
        raise LogError(
            f'{at}: an angular frequency is in rad/s, and Hz is stated: state which with --unit "{column.name}=rad/s", '
            "or rename the column"
        )
    try:
        if column.role == "frequency" and column.unit in ("rad/s", "rad s^-1"):
            return 1.0 / (2.0 * math.pi)
        if column.role == "angular_frequency" and column.unit in ("1/s", "s^-1"):
            return 1.0
        if si == "1/Pa":
            return 1.0 / to_si(f"1 {column.unit.removeprefix('1/')}", "Pa")
        if si == "1" and column.unit in ("1", "m/m", "mm/mm"):
            return 1.0
        return to_si(f"1 {column.unit}", si)
    except ValueError as error:
        raise LogError(f"{at}: {error}") from error


def example_unit(role: str) -> tuple[str, ...]:
    """What the unit of a role can be; none for a role that needs none."""
    si = _ROLES[role][0]
    others = {"frequency": ("Hz", "rad/s"), "strain": ("%", "1"), "phase": ("deg", "rad")}
    return others.get(role, () if si in ("", "°C") else (si,))


def place(text: InstrumentText, block: TableBlock, column: TableColumn, row: int | None = None) -> str:
    """Where a column's name, or one of its cells, stands: file, line and column."""
    line = block.names_line if row is None else block.rows[row].number
    return f"{text.path}:{line or block.rows[0].number}, column {column.index + 1} {column.name!r}"
