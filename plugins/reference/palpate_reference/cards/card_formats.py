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

_MAX_PAIRS = 3  # of a line of TBDATA, which has six constants


@dataclass(frozen=True)
class CardFormat:
    """Writer and reader of a program's card."""

    text: Callable[[PronySeries], str]
    series: Callable[[str], PronySeries]  # raises ValueError, KeyError or IndexError for another text


def _abaqus(series: PronySeries) -> str:
    """Return *HYPERELASTIC with C10 = G_0/2 and D1 = 2/K_0, and *VISCOELASTIC with rows g_k, k_k, tau_k."""
    bulk = series.bulk
    compliance = card_number(2.0 / bulk) if bulk else "0."
    lines = [f"** {remark}" for remark in series.remarks]
    lines += [
        "** units: Pa, s",
        "*MATERIAL, NAME=PALPATE",
        "*HYPERELASTIC, NEO HOOKE, MODULI=INSTANTANEOUS",
        f"{card_number(series.instant / 2.0)}, {compliance}",
        "*VISCOELASTIC, TIME=PRONY",
    ]
    for share, time in series.shares:
        bulk_share = card_number(share) if bulk else "0."
        lines.append(f"{card_number(share)}, {bulk_share}, {card_number(time)}")
    return "\n".join(lines) + "\n"


def _from_abaqus(text: str) -> PronySeries:
    """Return the series of a card as `_abaqus` writes it."""
    lines = [line for line in text.splitlines() if not line.startswith("**")]
    index_of = {line.split(",")[0].strip().upper(): k for k, line in enumerate(lines) if line.startswith("*")}
    c10, compliance = (float(cell) for cell in lines[index_of["*HYPERELASTIC"] + 1].split(","))
    shares = []
    for line in lines[index_of["*VISCOELASTIC"] + 1 :]:
        if line.strip():
            cells = [float(cell) for cell in line.split(",")]
            shares.append((cells[0], cells[2]))
    return _instantaneous_series(2.0 * c10, compliance, shares)


def _ansys(series: PronySeries) -> str:
    """Return TB,HYPER with G_0 and 2/K_0, and TB,PRONY with pairs g_k, tau_k, of the bulk as well if it is finite."""
    bulk = series.bulk
    lines = [f"! {remark}" for remark in series.remarks]
    lines += ["! units: Pa, s", "TB,HYPER,1,1,2,NEO"]
    lines += [f"TBDATA,1,{card_number(series.instant)},{card_number(2.0 / bulk) if bulk else '0'}"]
    for modulus in ("SHEAR", "BULK") if bulk else ("SHEAR",):
        lines.append(f"TB,PRONY,1,1,{len(series.arms)},{modulus}")
        for first in range(0, len(series.shares), _MAX_PAIRS):
            pairs = series.shares[first : first + _MAX_PAIRS]
            cells = [card_number(number) for pair in pairs for number in pair]
            lines.append(f"TBDATA,{2 * first + 1},{','.join(cells)}")
    return "\n".join(lines) + "\n"


def _from_ansys(text: str) -> PronySeries:
    """Return the series of a card as `_ansys` writes it: constants of TBDATA belong to the last TB."""
    constants: dict[str, list[float]] = {}
    table = ""
    for line in text.splitlines():
        cells = [cell.strip() for cell in line.partition("!")[0].split(",")]
        if cells[0].upper() == "TB":
            table = cells[1].upper() if cells[1].upper() != "PRONY" else cells[5].upper()
            constants[table] = []
        elif cells[0].upper() == "TBDATA":
            constants[table] += [float(cell) for cell in cells[2:]]
    instant, compliance = constants["HYPER"]
    shares = list(zip(constants["SHEAR"][::2], constants["SHEAR"][1::2], strict=True))
    return _instantaneous_series(instant, compliance, shares)


def _instantaneous_series(instant: float, compliance: float, shares: Sequence[tuple[float, float]]) -> PronySeries:
    """Return the series of G_0 [Pa], 2/K_0 [1/Pa], 0 if incompressible, and pairs of G_k/G_0 and tau_k [s].

    nu = (3 K_0 - 2 G_0)/(2 (3 K_0 + G_0)).
    """
    bulk = 2.0 / compliance if compliance else None
    poisson = 0.5 if bulk is None else (3.0 * bulk - 2.0 * instant) / (2.0 * (3.0 * bulk + instant))
    arms = tuple((share * instant, time) for share, time in shares)
    lasting = max(instant * (1.0 - sum(share for share, _ in shares)), 0.0)
    return PronySeries(lasting, arms, poisson)


def _febio(series: PronySeries) -> str:
    """Return a viscoelastic material with g0 = G_inf/G_0, g_k = G_k/G_0, t_k, and E and v of the first instant."""
    poisson = min(series.poisson, STIFFEST)
    lines = ['<?xml version="1.0" encoding="UTF-8"?>']
    lines += [f"<!-- {remark.replace('--', '-')} -->" for remark in series.remarks]
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
    """Return the series of a card as `_febio` writes it."""
    values = {tag: float(number) for tag, number in re.findall(r"<(\w+)>([^<]+)</\1>", text)}
    instant = values["E"] / (2.0 * (1.0 + values["v"]))
    count = sum(re.fullmatch(r"t\d+", tag) is not None for tag in values)
    arms = tuple((values[f"g{k}"] * instant, values[f"t{k}"]) for k in range(1, count + 1))
    return PronySeries(values["g0"] * instant, arms, values["v"])


def _comsol(series: PronySeries) -> str:
    """Return a table of parameters: G_inf, nu, and G_k and tau_k of each branch, as NAME VALUE "description"."""
    remarks = "; ".join(series.remarks).replace('"', "'")
    lines = [f'G_inf {card_number(series.lasting)}[Pa] "long-time shear modulus; {remarks}"']
    lines += [f'nu {card_number(series.poisson)} "Poisson\'s ratio"']
    for k, (strength, time) in enumerate(series.arms, 1):
        lines += [f'G_{k} {card_number(strength)}[Pa] "shear modulus of branch {k}"']
        lines += [f'tau_{k} {card_number(time)}[s] "relaxation time of branch {k}"']
    return "\n".join(lines) + "\n"


def _from_comsol(text: str) -> PronySeries:
    """Return the series of a table as `_comsol` writes it."""
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
