"""The columns of an instrument's table: roles by their names, units, and numbers in SI."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from palpate import Floats, LogError, is_unit, suggest, to_si

from palpate_reference.instrument_text import InstrumentText
from palpate_reference.table_blocks import TableBlock

_MAX_NAME_LENGTH = 200  # characters of a name that may have a unit, a choice
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
    """One column: its role, its place and its unit."""

    role: str
    index: int
    name: str
    unit: str  # as written; empty where none is
    shear: bool | None = None  # of a modulus: True of shear, False of Young; None if the name does not say
    std: bool = False  # True for the standard uncertainty of its role


def columns_of(
    text: InstrumentText, block: TableBlock, stated: Mapping[str, str], roles: Mapping[str, str] = {}
) -> dict[str, TableColumn]:
    """Return the columns by role, ``ROLE_std`` for uncertainties.

    A person states units by `stated` (by name of a column), and columns by `roles` (names by role); both come before
    the file's own. Of a table that has moduli of shear and of Young those of shear. Raises LogError for an unknown
    role.
    """
    if wrong := next((role for role in roles if role not in _ROLES), None):
        raise LogError(f"{text.path}: --column: no role {wrong!r}{suggest(wrong, _ROLES)}")
    role_of_name = {name: role for role, name in roles.items()}
    columns: dict[str, TableColumn] = {}
    for index, heading in enumerate(block.names):
        # The unit is the stated one, else that of the row of units, else that of the name.
        name, unit = name_and_unit(heading)
        if index < len(block.units) and block.units[index]:
            unit = block.units[index]
        unit = stated.get(heading, stated.get(name, unit))
        unit = _ALIASES.get(unit, unit)
        stated_role = role_of_name.get(heading, role_of_name.get(name))
        if stated_role is not None:
            column: TableColumn | None = TableColumn(stated_role, index, heading, unit)
        else:
            column = _recognised_column(index, heading, name, unit)
        if column is None or (stated_role is None and column.role in roles):
            continue
        key = f"{column.role}_std" if column.std else column.role
        if key not in columns or (columns[key].shear is False and column.shear):
            columns[key] = column
    return columns


def demand_names(text: InstrumentText, headings: set[str], option: str, stated: Iterable[str]) -> None:
    """Raise LogError where a person names a column that is in no table of the file."""
    known_names = {*headings, *(name_and_unit(heading)[0] for heading in headings)}
    for name in stated:
        if name not in known_names:
            candidates = {heading for heading in headings if heading}
            raise LogError(f"{text.path}: {option}: no column {name!r}{suggest(name, candidates)}")


def name_and_unit(heading: str) -> tuple[str, str]:
    """Return the name of a column without its unit, and the unit; an empty unit for a heading without one.

    >>> name_and_unit("G' [kPa]"), name_and_unit("E_std_Pa"), name_and_unit("J_per_Pa"), name_and_unit("G(t) (Pa)")
    (("G'", 'kPa'), ('E std', 'Pa'), ('J', '1/Pa'), ('G(t)', 'Pa'))
    >>> name_and_unit("omega / rad/s"), name_and_unit("tan(delta)")
    (('omega', 'rad/s'), ('tan(delta)', ''))
    """
    heading = heading.strip()
    if len(heading) > _MAX_NAME_LENGTH:  # the patterns below take the square of the time of a name's length
        return heading, ""
    # "E_std_Pa", "J_per_Pa"
    if match := _UNIT_IN_NAME.search(heading):
        return heading[: match.start()].replace("_", " "), f"1/{match[2]}" if match[1] else match[2]
    # "G' in Pa"
    if (match := _UNIT_NAMED.search(heading)) and (is_unit(match[1]) or match[1].startswith("°")):
        return heading[: match.start()].strip(), match[1]
    # "G' [kPa]", but not "G(t)", nor "std(G')", where the brackets hold a name
    match = None if _OF_TIME.fullmatch(heading) else _UNIT_BEHIND.search(heading)
    if match and (is_unit(match[1].strip()) or heading[: match.start()].strip().lower() not in ("u", "std", "sd")):
        return heading[: match.start()].strip().replace("_", " "), match[1].strip()
    # "omega / rad/s", "G', Pa"
    if (match := _UNIT_OVER.fullmatch(heading)) and is_unit(match[2]):
        return match[1].replace("_", " "), match[2]
    return heading.replace("_", " "), ""


def _without_brackets(name: str) -> str:
    """Return a name without the bracket that encloses it."""
    name = name.lstrip("( ")
    return name.removesuffix(")") if name.count(")") > name.count("(") else name


def _recognised_column(index: int, heading: str, name: str, unit: str) -> TableColumn | None:
    """Return the column of a name that a program gives to a role; None for any other name."""
    plain = re.sub(r"[’′`´]", "'", name).replace("″", "''").replace('"', "''").strip()
    if plain == "T":  # a small t is the time
        return TableColumn("temperature", index, heading, unit)
    plain = " ".join(plain.lower().split())
    std_match = _STD.fullmatch(plain)
    if std_match is not None:
        plain = _without_brackets(std_match[1] or std_match[2])
    for role, (_, pattern) in _ROLES.items():
        if match := re.fullmatch(pattern, plain):
            # The words or letters of a modulus, of shear or of Young.
            groups = match.groupdict()
            modulus_word = groups.get("kind") or groups.get("kind2") or groups.get("kind3")
            shear = None if modulus_word is None else modulus_word not in _YOUNG
            return TableColumn(role, index, heading, unit, shear, std=std_match is not None)
    return None


def si_values(text: InstrumentText, block: TableBlock, column: TableColumn) -> Floats:
    """Return the numbers (n,) of a column in SI, NaN where a cell is empty; raises LogError with line and column."""
    factor, offset = _scale(text, block, column)
    values = np.empty(len(block.rows))
    for k, line in enumerate(block.rows):
        cell = line.cell(column.index)
        cell_place = f"{text.path}:{line.number}, column {column.index + 1} {column.name!r}"
        if column.index >= len(line.cells):
            raise LogError(f"{cell_place}: the line ends before it: the file is cut short, or its columns differ")
        if not cell:
            values[k] = math.nan
            continue
        if not text.is_number(cell):
            raise LogError(f"{cell_place}: {cell[:40]!r} is not a number")
        values[k] = text.number(cell) * factor + offset
        if not math.isfinite(values[k]):
            raise LogError(f"{cell_place}: {cell!r} is not a finite number; take the row out")
    return values


def _scale(text: InstrumentText, block: TableBlock, column: TableColumn) -> tuple[float, float]:
    """Return factor and offset by which the numbers of a column become those in the SI unit of its role.

    Temperatures become °C. Raises LogError for a unit of another kind, or none.
    """
    if _ROLES[column.role][0] != "°C":
        return _factor(text, block, column), 0.0
    unit = column.unit.lstrip("°º \u02da\N{REPLACEMENT CHARACTER}").removeprefix("deg").strip() or "C"
    if unit not in _ZEROS:
        raise LogError(f"{place(text, block, column)}: a temperature is in °C or K, not in {column.unit!r}")
    return 1.0, _ZEROS[unit]


def _factor(text: InstrumentText, block: TableBlock, column: TableColumn) -> float:
    """Return the unit of a column over the SI unit of its role; raises LogError for one of another kind, or none."""
    si_unit = _ROLES[column.role][0]
    column_place = place(text, block, column)
    if not si_unit:
        return 1.0
    if not column.unit:
        first, *other_units = example_unit(column.role)
        alternatives = "".join(f' or "{other}"' for other in other_units)
        raise LogError(f'{column_place}: has no unit: state it with --unit "{column.name}={first}"{alternatives}')
    if column.role == "angular_frequency" and column.unit == "Hz":
        raise LogError(
            f"{column_place}: an angular frequency is in rad/s, and Hz is stated: "
            f'state which with --unit "{column.name}=rad/s", or rename the column'
        )
    try:
        if column.role == "frequency" and column.unit in ("rad/s", "rad s^-1"):
            return 1.0 / (2.0 * math.pi)
        if column.role == "angular_frequency" and column.unit in ("1/s", "s^-1"):
            return 1.0
        if si_unit == "1/Pa":
            return 1.0 / to_si(f"1 {column.unit.removeprefix('1/')}", "Pa")
        if si_unit == "1" and column.unit in ("1", "m/m", "mm/mm"):
            return 1.0
        return to_si(f"1 {column.unit}", si_unit)
    except ValueError as error:
        raise LogError(f"{column_place}: {error}") from error


def example_unit(role: str) -> tuple[str, ...]:
    """Return the usual units of a role; empty for a role that needs none."""
    si_unit = _ROLES[role][0]
    usual_units = {"frequency": ("Hz", "rad/s"), "strain": ("%", "1"), "phase": ("deg", "rad")}
    return usual_units.get(role, () if si_unit in ("", "°C") else (si_unit,))


def place(text: InstrumentText, block: TableBlock, column: TableColumn, row: int | None = None) -> str:
    """Return file, line and column of a column's name, or of its cell in a row (counted from 0), as a text."""
    line = block.names_line if row is None else block.rows[row].number
    return f"{text.path}:{line or block.rows[0].number}, column {column.index + 1} {column.name!r}"
