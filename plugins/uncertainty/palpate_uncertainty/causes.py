"""Causes of a residual that is not noise: the material and what moves, of which a law is known; and the rig."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Cause:
    """One kind of cause: what it is of, and what is known of its effect."""

    of_rig: bool  # a fact of rig or specimen is wrong; else the material or what moves is not of the law
    one_sided: bool = False  # it only adds to the force what its derivative says: a negative size is not one
    # It acts with the speed or its direction, as a viscosity does: of 23 records 10 had theirs within 2u.
    moves: bool = False
    laws: tuple[str, ...] = ()  # models that describe it, by type


FADING = ("standard-linear-solid", "generalised-maxwell-2")  # laws of a modulus that fades with time
_MATERIAL, _RIG = Cause(of_rig=False), Cause(of_rig=True)
CAUSES = {
    "memory": Cause(of_rig=False, one_sided=True, laws=FADING),
    "stiffness that changes": _MATERIAL,
    "unloading": Cause(of_rig=False, moves=True),
    "unloading that is softer": Cause(of_rig=False, one_sided=True, laws=FADING),
    "lift-off": _MATERIAL,
    "surface moved": _MATERIAL,
    "surface moved in steps": _MATERIAL,
    "drift": _MATERIAL,
    "drift in steps": _MATERIAL,
    "drag": Cause(of_rig=False, one_sided=True, moves=True),
    "friction": Cause(of_rig=False, one_sided=True, moves=True),
    "wrong-tip": _RIG,
    "a fixed value": _RIG,
    "thickness": _RIG,
    "second contact": Cause(of_rig=True, one_sided=True),
    "timing": _RIG,
    "mass": _RIG,
    "compliance": Cause(of_rig=True, one_sided=True),
    "command": _RIG,
    "force at its limit": Cause(of_rig=True, one_sided=True),
    "zero of the force": _RIG,
    "cable": _RIG,
    "adhesion": Cause(of_rig=True, one_sided=True),
}


def cause_of(name: str) -> Cause:
    """Return the kind of a cause by its name, such as "memory of 0.3 s".

    >>> cause_of("memory of 0.3 s").of_rig
    False
    """
    return CAUSES[name if name in CAUSES else name.partition(" of ")[0]]
