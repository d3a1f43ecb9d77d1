"""Cards of hyperelastic solids for four programs, written and read: incompressible, without a series of times.

Each program has its own constants of the same strain energy: Ogden's are mu of Abaqus, 2 mu/alpha of ANSYS and COMSOL,
2 mu of FEBio.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from palpate_reference.cards.card_text import STIFFEST, Program, card_number, febio_lines
from palpate_reference.hyperelastic.strain_energies import energy_of


@dataclass(frozen=True)
class HyperelasticSolid:
    """A strain energy at its values [SI]."""

    law: str
    values: tuple[float, ...]
    remarks: tuple[str, ...] = ()  # law, values and uncertainties, in words

    @property
    def bulk(self) -> float:
        """K [Pa] for a program that cannot have an incompressible solid: that of Poisson's ratio 0.495."""
        law = energy_of(self.law)
        assert law is not None
        return 2.0 * law.shear_modulus(self.values) * (1.0 + STIFFEST) / (3.0 * (1.0 - 2.0 * STIFFEST))


@dataclass(frozen=True)
class HyperelasticCard:
    """How a program's card is written and read."""

    text: Callable[[HyperelasticSolid], str]
    solid: Callable[[str], HyperelasticSolid]  # raises ValueError, KeyError or IndexError for another text


_ABAQUS = {"neo-hookean": "NEO HOOKE", "mooney-rivlin": "MOONEY-RIVLIN", "yeoh": "YEOH", "ogden": "N=1, OGDEN"}
_ANSYS = {"neo-hookean": "2,NEO", "mooney-rivlin": "2,MOONEY", "yeoh": "3,YEOH", "ogden": "1,OGDEN"}
_FEBIO = {"mooney-rivlin": "Mooney-Rivlin", "yeoh": "Yeoh", "ogden": "Ogden"}
_COMSOL = {"neo-hookean": ("mu",), "mooney-rivlin": ("C10", "C01"), "yeoh": ("c1", "c2", "c3"),
           "ogden": ("mu_p", "alpha_p")}  # fmt: skip
_VOLUMES = {"yeoh": 3}  # constants of the volume; of others one


def _halved(law: str, values: Sequence[float]) -> list[float]:
    """C10 = G/2 of a neo-Hookean solid; other values as they are."""
    return [values[0] / 2.0] if law == "neo-hookean" else list(values)


def _over_alpha(law: str, values: Sequence[float]) -> list[float]:
    """2 mu/alpha of Ogden's mu; other values as they are."""
    return [2.0 * values[0] / values[1], values[1]] if law == "ogden" else list(values)


def _from_over_alpha(law: str, values: Sequence[float]) -> tuple[float, ...]:
    return (values[0] * values[1] / 2.0, values[1]) if law == "ogden" else tuple(values)


def _abaqus(solid: HyperelasticSolid) -> str:
    cells = [*map(card_number, _halved(solid.law, solid.values)), *["0."] * _VOLUMES.get(solid.law, 1)]
    lines = [f"** {line}" for line in solid.remarks]
    lines += ["** units: Pa; incompressible", "*MATERIAL, NAME=PALPATE", f"*HYPERELASTIC, {_ABAQUS[solid.law]}"]
    return "\n".join([*lines, ", ".join(cells)]) + "\n"


def _from_abaqus(text: str) -> HyperelasticSolid:
    lines = [line for line in text.splitlines() if not line.startswith("**")]
    at = next(k for k, line in enumerate(lines) if line.upper().startswith("*HYPERELASTIC"))
    law = next(name for name, word in _ABAQUS.items() if lines[at].upper().endswith(word))
    cells = [float(cell) for cell in lines[at + 1].split(",")][: -_VOLUMES.get(law, 1)]
    return HyperelasticSolid(law, (2.0 * cells[0],) if law == "neo-hookean" else tuple(cells))


def _ansys(solid: HyperelasticSolid) -> str:
    cells = [*map(card_number, _over_alpha(solid.law, solid.values)), *["0"] * _VOLUMES.get(solid.law, 1)]
    lines = [f"! {line}" for line in solid.remarks]
    lines += ["! units: Pa; incompressible", f"TB,HYPER,1,1,{_ANSYS[solid.law]}", f"TBDATA,1,{','.join(cells)}"]
    return "\n".join(lines) + "\n"


def _from_ansys(text: str) -> HyperelasticSolid:
    lines = [line.partition("!")[0].strip() for line in text.splitlines()]
    lines = [line for line in lines if line]
    at = next(k for k, line in enumerate(lines) if line.upper().startswith("TB,HYPER"))
    law = next(name for name, words in _ANSYS.items() if lines[at].upper().endswith(words))
    cells = [float(cell) for cell in lines[at + 1].split(",")[2:]][: -_VOLUMES.get(law, 1)]
    return HyperelasticSolid(law, _from_over_alpha(law, cells))


def _febio(solid: HyperelasticSolid) -> str:
    about = "units: Pa; the bulk modulus is that of Poisson's ratio 0.495, since none is infinite"
    if solid.law == "neo-hookean":
        tags = [("E", 2.0 * (1.0 + STIFFEST) * solid.values[0]), ("v", STIFFEST)]
        return febio_lines("neo-Hookean", [*solid.remarks, about], tags)
    if solid.law == "ogden":
        tags = [("c1", 2.0 * solid.values[0]), ("m1", solid.values[1])]
    else:
        tags = [(f"c{k}", value) for k, value in enumerate(solid.values, 1)]
    return febio_lines(_FEBIO[solid.law], [*solid.remarks, about], [*tags, ("k", solid.bulk)])


def _from_febio(text: str) -> HyperelasticSolid:
    values = {name: float(number) for name, number in re.findall(r"<(\w+)>([^<]+)</\1>", text)}
    kind = re.findall(r'<material [^>]*type="([^"]+)"', text)[0]
    if kind == "neo-Hookean":
        return HyperelasticSolid("neo-hookean", (values["E"] / (2.0 * (1.0 + values["v"])),))
    law = next(name for name, word in _FEBIO.items() if word == kind)
    if law == "ogden":
        return HyperelasticSolid(law, (values["c1"] / 2.0, values["m1"]))
    count = 2 if law == "mooney-rivlin" else 3
    return HyperelasticSolid(law, tuple(values[f"c{k}"] for k in range(1, count + 1)))


def _comsol(solid: HyperelasticSolid) -> str:
    about = "; ".join(solid.remarks).replace('"', "'")
    lines = []
    for name, value in zip(_COMSOL[solid.law], _over_alpha(solid.law, solid.values), strict=True):
        unit = "" if name == "alpha_p" else "[Pa]"
        lines.append(f'{name} {card_number(value)}{unit} "{solid.law}, incompressible; {about}"')
    return "\n".join(lines) + "\n"


def _from_comsol(text: str) -> HyperelasticSolid:
    values = {line.split()[0]: float(line.split()[1].partition("[")[0]) for line in text.splitlines()}
    law = next(name for name, names in _COMSOL.items() if set(names) == values.keys())
    return HyperelasticSolid(law, _from_over_alpha(law, [values[name] for name in _COMSOL[law]]))


HYPERELASTIC_CARDS: Mapping[Program, HyperelasticCard] = {
    "abaqus": HyperelasticCard(_abaqus, _from_abaqus),
    "ansys": HyperelasticCard(_ansys, _from_ansys),
    "febio": HyperelasticCard(_febio, _from_febio),
    "comsol": HyperelasticCard(_comsol, _from_comsol),
}
