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
    """Writer and reader of a program's card."""

    text: Callable[[HyperelasticSolid], str]
    solid: Callable[[str], HyperelasticSolid]  # raises ValueError, KeyError or IndexError for another text


# Names of the laws in each program.
_ABAQUS = {"neo-hookean": "NEO HOOKE", "mooney-rivlin": "MOONEY-RIVLIN", "yeoh": "YEOH", "ogden": "N=1, OGDEN"}
_ANSYS = {"neo-hookean": "2,NEO", "mooney-rivlin": "2,MOONEY", "yeoh": "3,YEOH", "ogden": "1,OGDEN"}
_FEBIO = {"mooney-rivlin": "Mooney-Rivlin", "yeoh": "Yeoh", "ogden": "Ogden"}
_COMSOL = {"neo-hookean": ("mu",), "mooney-rivlin": ("C10", "C01"), "yeoh": ("c1", "c2", "c3"),
           "ogden": ("mu_p", "alpha_p")}  # fmt: skip
_VOLUME_CONSTANTS = {"yeoh": 3}  # on a card of Abaqus or ANSYS; of other laws one


def _halved(law: str, values: Sequence[float]) -> list[float]:
    """Return C10 = G/2 of a neo-Hookean solid; the values of any other law."""
    return [values[0] / 2.0] if law == "neo-hookean" else list(values)


def _over_alpha(law: str, values: Sequence[float]) -> list[float]:
    """Return 2 mu/alpha and alpha of Ogden's law; the values of any other law."""
    return [2.0 * values[0] / values[1], values[1]] if law == "ogden" else list(values)


def _from_over_alpha(law: str, values: Sequence[float]) -> tuple[float, ...]:
    """Return the inverse of `_over_alpha`."""
    return (values[0] * values[1] / 2.0, values[1]) if law == "ogden" else tuple(values)


def _abaqus(solid: HyperelasticSolid) -> str:
    """Return *HYPERELASTIC with the constants of the law, then 0 for those of the volume."""
    cells = [*map(card_number, _halved(solid.law, solid.values)), *["0."] * _VOLUME_CONSTANTS.get(solid.law, 1)]
    lines = [f"** {line}" for line in solid.remarks]
    lines += ["** units: Pa; incompressible", "*MATERIAL, NAME=PALPATE", f"*HYPERELASTIC, {_ABAQUS[solid.law]}"]
    return "\n".join([*lines, ", ".join(cells)]) + "\n"


def _from_abaqus(text: str) -> HyperelasticSolid:
    """Return the solid of a card as `_abaqus` writes it."""
    lines = [line for line in text.splitlines() if not line.startswith("**")]
    index = next(k for k, line in enumerate(lines) if line.upper().startswith("*HYPERELASTIC"))
    law = next(name for name, abaqus_name in _ABAQUS.items() if lines[index].upper().endswith(abaqus_name))
    cells = [float(cell) for cell in lines[index + 1].split(",")][: -_VOLUME_CONSTANTS.get(law, 1)]
    return HyperelasticSolid(law, (2.0 * cells[0],) if law == "neo-hookean" else tuple(cells))


def _ansys(solid: HyperelasticSolid) -> str:
    """Return TB,HYPER with the constants of the law, then 0 for those of the volume."""
    cells = [*map(card_number, _over_alpha(solid.law, solid.values)), *["0"] * _VOLUME_CONSTANTS.get(solid.law, 1)]
    lines = [f"! {line}" for line in solid.remarks]
    lines += ["! units: Pa; incompressible", f"TB,HYPER,1,1,{_ANSYS[solid.law]}", f"TBDATA,1,{','.join(cells)}"]
    return "\n".join(lines) + "\n"


def _from_ansys(text: str) -> HyperelasticSolid:
    """Return the solid of a card as `_ansys` writes it."""
    lines = [line.partition("!")[0].strip() for line in text.splitlines()]
    lines = [line for line in lines if line]
    index = next(k for k, line in enumerate(lines) if line.upper().startswith("TB,HYPER"))
    law = next(name for name, ansys_name in _ANSYS.items() if lines[index].upper().endswith(ansys_name))
    cells = [float(cell) for cell in lines[index + 1].split(",")[2:]][: -_VOLUME_CONSTANTS.get(law, 1)]
    return HyperelasticSolid(law, _from_over_alpha(law, cells))


def _febio(solid: HyperelasticSolid) -> str:
    """Return a material with the constants c_k, and m1 of Ogden's law; of a neo-Hookean solid with E and v."""
    units = "units: Pa; the bulk modulus is that of Poisson's ratio 0.495, since none is infinite"
    if solid.law == "neo-hookean":
        tags = [("E", 2.0 * (1.0 + STIFFEST) * solid.values[0]), ("v", STIFFEST)]
        return febio_lines("neo-Hookean", [*solid.remarks, units], tags)
    if solid.law == "ogden":
        tags = [("c1", 2.0 * solid.values[0]), ("m1", solid.values[1])]
    else:
        tags = [(f"c{k}", value) for k, value in enumerate(solid.values, 1)]
    return febio_lines(_FEBIO[solid.law], [*solid.remarks, units], [*tags, ("k", solid.bulk)])


def _from_febio(text: str) -> HyperelasticSolid:
    """Return the solid of a card as `_febio` writes it."""
    values = {tag: float(number) for tag, number in re.findall(r"<(\w+)>([^<]+)</\1>", text)}
    febio_type = re.findall(r'<material [^>]*type="([^"]+)"', text)[0]
    if febio_type == "neo-Hookean":
        return HyperelasticSolid("neo-hookean", (values["E"] / (2.0 * (1.0 + values["v"])),))
    law = next(name for name, febio_name in _FEBIO.items() if febio_name == febio_type)
    if law == "ogden":
        return HyperelasticSolid(law, (values["c1"] / 2.0, values["m1"]))
    count = 2 if law == "mooney-rivlin" else 3
    return HyperelasticSolid(law, tuple(values[f"c{k}"] for k in range(1, count + 1)))


def _comsol(solid: HyperelasticSolid) -> str:
    """Return a table of parameters, as NAME VALUE "description"."""
    remarks = "; ".join(solid.remarks).replace('"', "'")
    lines = []
    for name, value in zip(_COMSOL[solid.law], _over_alpha(solid.law, solid.values), strict=True):
        unit = "" if name == "alpha_p" else "[Pa]"
        lines.append(f'{name} {card_number(value)}{unit} "{solid.law}, incompressible; {remarks}"')
    return "\n".join(lines) + "\n"


def _from_comsol(text: str) -> HyperelasticSolid:
    """Return the solid of a table as `_comsol` writes it."""
    values = {line.split()[0]: float(line.split()[1].partition("[")[0]) for line in text.splitlines()}
    law = next(name for name, names in _COMSOL.items() if set(names) == values.keys())
    return HyperelasticSolid(law, _from_over_alpha(law, [values[name] for name in _COMSOL[law]]))


HYPERELASTIC_CARDS: Mapping[Program, HyperelasticCard] = {
    "abaqus": HyperelasticCard(_abaqus, _from_abaqus),
    "ansys": HyperelasticCard(_ansys, _from_ansys),
    "febio": HyperelasticCard(_febio, _from_febio),
    "comsol": HyperelasticCard(_comsol, _from_comsol),
}
