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
    words: str = ""  # in a sentence, where its name says too little
    advice: str = ""  # what to do, where no fact states it

    @property
    def remedy(self) -> str:
        """The option that states the fact, or the advice; empty where there is neither."""
        if not self.fact:
            return self.advice
        return f"{option_of(self.fact)} VALUE" if self.fact == "tip" else words_that_state(self.fact)


FADING = ("standard-linear-solid", "generalised-maxwell-2")  # laws of a modulus that fades with time
_MATERIAL = Cause(of_rig=False)
_TWO_SPEEDS = 'Press at two speeds, or fit the way in alone (segment = "load" of the fit).'
CAUSES = {
    "memory": Cause(of_rig=False, one_sided=True, laws=FADING),
    "stiffness that changes": _MATERIAL,
    "unloading": Cause(of_rig=False, moves=True, words="a force that differs on the way out", advice=_TWO_SPEEDS),
    "unloading that is softer": Cause(of_rig=False, one_sided=True, laws=FADING),
    "lift-off": _MATERIAL,
    "surface moved": _MATERIAL,
    "surface moved in steps": _MATERIAL,
    "drift": _MATERIAL,
    "drift in steps": _MATERIAL,
    "drag": Cause(of_rig=False, one_sided=True, moves=True, words="a drag", advice=_TWO_SPEEDS),
    "friction": Cause(of_rig=False, one_sided=True, moves=True, advice=_TWO_SPEEDS),
    "another tip": Cause(
        True, sign="the force grows with depth otherwise than under this tip", fact="tip"
    ),
    "a fixed value": Cause(
        True, sign="a value that is held fixed does not describe the force", words="another value of what is fixed",
        advice="Free the value that is held fixed, or state another.",
    ),
    "thickness": Cause(
        True, sign="the force grows with depth otherwise than on this layer", fact="thickness",
        words="another thickness",
    ),
    "second contact": Cause(
        True, one_sided=True, sign="from some depth on the force grows as by a second contact",
        advice="Find what else touches from that depth on (the base, the holder), or press less deep.",
    ),
    "timing": Cause(
        True, sign="the force is early or late against the motion", fact="delay", words="a delay of the force"
    ),
    "mass": Cause(
        True, sign="a part of the force follows the acceleration", fact="mass", words="a mass behind the sensor"
    ),
    "compliance": Cause(
        True, one_sided=True, sign="something gives way to the force", fact="mount", words="a mount that gives way"
    ),
    "command": Cause(
        True, sign="the force lags the position, as one that is a command", fact="position",
        words="a position that is a command",
    ),
    "force at its limit": Cause(
        True, one_sided=True, sign="the force stops growing, as at the limit of its sensor",
        words="a sensor at its limit", advice="Press less deep, or use a sensor of a larger range.",
    ),
    "zero of the force": Cause(True, sign="a constant force remains", fact="tare", words="another zero of the force"),
    "cable": Cause(
        True, sign="a force that follows the height remains, as of a cable", words="the pull of a cable",
        advice="Guide the cable so that it does not pull, or record air over the depth of the press first.",
    ),
    "adhesion": Cause(
        True, one_sided=True, sign="the surface pulls at the tip",
        advice="Use the model jkr (soft, large tips) or dmt (stiff, small ones), or wet the surface.",
    ),
}  # fmt: skip


def cause_of(name: str) -> Cause:
    """Return the kind of a cause by its name.

    >>> cause_of("memory of 0.3 s").of_rig
    False
    """
    return CAUSES[_key(name)]


def cause_label(name: str) -> str:
    """Return a cause in the head of a finding: the fact that states it, else its kind.

    >>> cause_label("memory of 0.3 s"), cause_label("zero of the force"), cause_label("another tip")
    ('memory', 'tare', 'tip')
    """
    return cause_of(name).fact or _key(name)


def _key(name: str) -> str:
    return name if name in CAUSES else name.partition(" of ")[0]


def cause_words(name: str, is_layer: bool = True) -> str:
    """Return a cause in a sentence; of a model with a layer or without.

    >>> cause_words("second contact of 0.6"), cause_words("thickness", is_layer=False), cause_words("memory of 0.3 s")
    ('a second contact from 60 % of the depth on', 'a thin specimen', 'memory of 0.3 s')
    """
    key, _, size = name.partition(" of ")
    if key == "second contact" and size:
        return f"a second contact from {100 * float(size):.0f} % of the depth on"
    if key == "thickness" and not is_layer:
        return "a thin specimen"
    return cause_of(name).words or name


ON_HALF_SPACE = "the force grows {} with depth than on a half-space"  # where no thickness was stated


def sign_of(name: str, is_layer: bool, times: float) -> str:
    """Return the sign of a cause in a record; `times` its typical size it is there, of a model with a layer or without.

    >>> sign_of("thickness", False, 1.0)
    'the force grows faster with depth than on a half-space'
    """
    if name == "thickness" and not is_layer:
        return ON_HALF_SPACE.format("more slowly" if times < 0 else "faster")
    return cause_of(name).sign
