"""Causes of a residual that is not noise: the material and what moves, of which a law is known; and the rig."""

from __future__ import annotations

from dataclasses import dataclass

from palpate_engine import option_of, words_that_state


@dataclass(frozen=True)
class Cause:
    """One kind of cause: what it is of, and what is known of its effect."""

    of_rig: bool  # a fact of rig or specimen is wrong; else the material or what moves is not of the law
    one_sided: bool = False  # it only adds to the force what its derivative says: a negative size is not one
    # It acts with the speed or its direction, as a viscosity does: of 23 records 10 had theirs within 2u.
    moves: bool = False
    laws: tuple[str, ...] = ()  # models that describe it, by type
    sign: str = "the force is not that of the law"  # of it in the record
    fact: str = ""  # of a condition, or a key of rig.toml, that states it

    @property
    def remedy(self) -> str:
        """The option that states the fact; empty where no fact does."""
        if not self.fact:
            return ""
        return f"{option_of(self.fact)} VALUE" if self.fact == "tip" else words_that_state(self.fact)


FADING = ("standard-linear-solid", "generalised-maxwell-2")  # laws of a modulus that fades with time
_MATERIAL = Cause(of_rig=False)
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
    "wrong-tip": Cause(True, sign="the force grows with depth otherwise than under this tip", fact="tip"),
    "a fixed value": Cause(True, sign="a value that is held fixed does not describe the force"),
    "thickness": Cause(True, sign="the force grows with depth otherwise than on this layer", fact="thickness"),
    "second contact": Cause(True, one_sided=True, sign="from some depth on the force grows as by a second contact"),
    "timing": Cause(True, sign="the force is early or late against the motion", fact="delay"),
    "mass": Cause(True, sign="a part of the force follows the acceleration", fact="mass"),
    "compliance": Cause(True, one_sided=True, sign="something gives way to the force", fact="mount"),
    "command": Cause(True, sign="the force lags the position, as one that is a command", fact="position"),
    "force at its limit": Cause(True, one_sided=True, sign="the force stops growing, as at the limit of its sensor"),
    "zero of the force": Cause(True, sign="a constant force remains", fact="tare"),
    "cable": Cause(True, sign="a force that follows the height remains, as of a cable"),
    "adhesion": Cause(True, one_sided=True, sign="the surface pulls at the tip"),
}


def cause_of(name: str) -> Cause:
    """Return the kind of a cause by its name, such as "memory of 0.3 s".

    >>> cause_of("memory of 0.3 s").of_rig
    False
    """
    return CAUSES[name if name in CAUSES else name.partition(" of ")[0]]


ON_HALF_SPACE = "the force grows {} with depth than on a half-space"  # where no thickness was stated


def sign_of(name: str, is_layer: bool, times: float) -> str:
    """Return the sign of a cause in a record; `times` its typical size it is there, of a model with a layer or without.

    >>> sign_of("thickness", False, 1.0)
    'the force grows faster with depth than on a half-space'
    """
    if name == "thickness" and not is_layer:
        return ON_HALF_SPACE.format("more slowly" if times < 0 else "faster")
    return cause_of(name).sign
