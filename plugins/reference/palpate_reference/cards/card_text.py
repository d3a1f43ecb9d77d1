"""What cards of all kinds have in common: the programs, numbers, and the lines of FEBio's XML."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

Program = Literal["abaqus", "ansys", "febio", "comsol"]
STIFFEST = 0.495  # Poisson's ratio that FEBio's solids are given for 0.5


def card_number(value: float) -> str:
    """To twelve digits, as every program reads it."""
    return f"{value:.12g}"


def febio_lines(kind: str, remarks: Sequence[str], tags: Sequence[tuple[str, float]]) -> str:
    """Return a material of FEBio with its constants, remarks as comments."""
    lines = ['<?xml version="1.0" encoding="UTF-8"?>']
    lines += [f"<!-- {line.replace('--', '-')} -->" for line in remarks]
    lines += [f'<material id="1" name="palpate" type="{kind}">']
    lines += [f"  <{name}>{card_number(value)}</{name}>" for name, value in tags]
    return "\n".join([*lines, "</material>"]) + "\n"
