"""Cards of four programs, written and read: Abaqus and ANSYS input, FEBio XML, a table of parameters for COMSOL.

A neo-Hookean solid with the moduli of the first instant, and a Prony series of both shear and bulk: Poisson's ratio is
the same at all times.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from palpate_reference.cards.card_text import STIFFEST, Program, card_number
from palpate_reference.cards.prony_series import PronySeries

_PAIRS = 3  # of a line of TBDATA


@dataclass(frozen=True)
class CardFormat:
    """How a program's card is written and read."""

    text: Callable[[PronySeries], str]
    series: Callable[[str], PronySeries]  # raises ValueError, KeyError or IndexError for another text


def _abaqus(series: PronySeries) -> str:
    bulk = series.bulk
    lines = [f"** {line}" for line in series.remarks]
    lines += ["** units: Pa, s", "*MATERIAL, NAME=PALPATE", "*HYPERELASTIC, NEO HOOKE, MODULI=INSTANTANEOUS"]
    lines += [f"{card_number(series.instant / 2.0)}, {card_number(2.0 / bulk) if bulk else '0.'}"]
    lines += ["*VISCOELASTIC, TIME=PRONY"]
    lines += [f"{card_number(g)}, {card_number(g) if bulk else '0.'}, {card_number(tau)}" for g, tau in series.shares]
    return "\n".join(lines) + "\n"


def _from_abaqus(text: str) -> PronySeries:
    lines = [line for line in text.splitlines() if not line.startswith("**")]
    at = {line.split(",")[0].strip().upper(): k for k, line in enumerate(lines) if line.startswith("*")}
    half, compliance = (float(cell) for cell in lines[at["*HYPERELASTIC"] + 1].split(","))
    rows = [[float(cell) for cell in line.split(",")] for line in lines[at["*VISCOELASTIC"] + 1 :] if line.strip()]
    return _of_instant(2.0 * half, compliance, [(row[0], row[2]) for row in rows])


def _ansys(series: PronySeries) -> str:
    bulk = series.bulk
    lines = [f"! {line}" for line in series.remarks]
    lines += ["! units: Pa, s", "TB,HYPER,1,1,2,NEO"]
    lines += [f"TBDATA,1,{card_number(series.instant)},{card_number(2.0 / bulk) if bulk else '0'}"]
    for kind in ("SHEAR", "BULK") if bulk else ("SHEAR",):
        lines.append(f"TB,PRONY,1,1,{len(series.arms)},{kind}")
        for first in range(0, len(series.shares), _PAIRS):
            cells = [card_number(one) for pair in series.shares[first : first + _PAIRS] for one in pair]
            lines.append(f"TBDATA,{2 * first + 1},{','.join(cells)}")
    return "\n".join(lines) + "\n"


def _from_ansys(text: str) -> PronySeries:
    tables: dict[str, list[float]] = {}
    name = ""
    for line in text.splitlines():
        cells = [cell.strip() for cell in line.partition("!")[0].split(",")]
        if cells[0].upper() == "TB":
            name = cells[1].upper() if cells[1].upper() != "PRONY" else cells[5].upper()
            tables[name] = []
        elif cells[0].upper() == "TBDATA":
            tables[name] += [float(cell) for cell in cells[2:]]
    instant, compliance = tables["HYPER"]
    return _of_instant(instant, compliance, list(zip(tables["SHEAR"][::2], tables["SHEAR"][1::2], strict=True)))


def _of_instant(instant: float, compliance: float, shares: Sequence[tuple[float, float]]) -> PronySeries:
    """From G_0 [Pa], 2/K_0 [1/Pa] and G_k/G_0."""
    bulk = 2.0 / compliance if compliance else None
    poisson = 0.5 if bulk is None else (3.0 * bulk - 2.0 * instant) / (2.0 * (3.0 * bulk + instant))
    arms = tuple((share * instant, time) for share, time in shares)
    return PronySeries(max(instant * (1.0 - sum(share for share, _ in shares)), 0.0), arms, poisson)


def _febio(series: PronySeries) -> str:
    poisson = min(series.poisson, STIFFEST)
    lines = ['<?xml version="1.0" encoding="UTF-8"?>']
    lines += [f"<!-- {line.replace('--', '-')} -->" for line in series.remarks]
    lines += ["<!-- units: Pa, s; E by the shear modulus and this v, since v of 0.5 has no finite bulk modulus -->"]
    lines += ['<material id="1" name="palpate" type="viscoelastic">']
    lines += [f"  <g0>{card_number(series.lasting / series.instant)}</g0>"]
    for k, (share, time) in enumerate(series.shares, 1):
        lines += [f"  <g{k}>{card_number(share)}</g{k}>", f"  <t{k}>{card_number(time)}</t{k}>"]
    young = 2.0 * (1.0 + poisson) * series.instant
    lines += [
        '  <elastic type="neo-Hookean">',
        f"    <E>{card_number(young)}</E>",
        f"    <v>{card_number(poisson)}</v>",
    ]
    return "\n".join([*lines, "  </elastic>", "</material>"]) + "\n"


def _from_febio(text: str) -> PronySeries:
    values = {name: float(number) for name, number in re.findall(r"<(\w+)>([^<]+)</\1>", text)}
    instant = values["E"] / (2.0 * (1.0 + values["v"]))
    count = sum(re.fullmatch(r"t\d+", name) is not None for name in values)
    arms = tuple((values[f"g{k}"] * instant, values[f"t{k}"]) for k in range(1, count + 1))
    return PronySeries(values["g0"] * instant, arms, values["v"])


def _comsol(series: PronySeries) -> str:
    about = "; ".join(series.remarks).replace('"', "'")
    lines = [f'G_inf {card_number(series.lasting)}[Pa] "long-time shear modulus; {about}"']
    lines += [f'nu {card_number(series.poisson)} "Poisson\'s ratio"']
    for k, (strength, time) in enumerate(series.arms, 1):
        lines += [f'G_{k} {card_number(strength)}[Pa] "shear modulus of branch {k}"']
        lines += [f'tau_{k} {card_number(time)}[s] "relaxation time of branch {k}"']
    return "\n".join(lines) + "\n"


def _from_comsol(text: str) -> PronySeries:
    values = {}
    for line in text.splitlines():
        name, number = line.split()[:2]
        values[name] = float(number.partition("[")[0])
    count = sum(name.startswith("tau_") for name in values)
    arms = tuple((values[f"G_{k}"], values[f"tau_{k}"]) for k in range(1, count + 1))
    return PronySeries(values["G_inf"], arms, values["nu"])


FORMATS: Mapping[Program, CardFormat] = {
    "abaqus": CardFormat(_abaqus, _from_abaqus),
    "ansys": CardFormat(_ansys, _from_ansys),
    "febio": CardFormat(_febio, _from_febio),
    "comsol": CardFormat(_comsol, _from_comsol),
}
