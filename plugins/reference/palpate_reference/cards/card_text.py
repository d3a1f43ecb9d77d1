"""Common parts of cards of all kinds: the programs, numbers, and the lines of FEBio's XML."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

Program = Literal["abaqus", "ansys", "febio", "comsol"]
STIFFEST = 0.495  # Poisson's ratio of FEBio's solids for 0.5, a choice: a bulk modulus of 100 shear moduli


def card_number(value: float) -> str:
    """Return a number to twelve digits, as every program reads it."""
    return f"{value:.12g}"


def febio_lines(febio_type: str, remarks: Sequence[str], tags: Sequence[tuple[str, float]]) -> str:
    """Return a material of FEBio with its constants, remarks as comments."""
    lines = ['<?xml version="1.0" encoding="UTF-8"?>']
    lines += [f"<!-- {line.replace('--', '-')} -->" for line in remarks]
    lines += [f'<material id="1" name="palpate" type="{febio_type}">']
    lines += [f"  <{name}>{card_number(value)}</{name}>" for name, value in tags]
    return "\n".join([*lines, "</material>"]) + "\n"
