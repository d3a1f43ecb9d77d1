"""What the name of a column says: its role, and its unit."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache

from palpate_records.messages.readings import si_unit
from palpate_records.tables.column_words import (
    ANGULAR,
    BY_WORD,
    CARTESIAN,
    CELLS,
    EITHER,
    ELECTRICAL,
    EXACT,
    QUALIFIERS,
    READERS,
    READINGS,
    SPREADS,
    SYMBOLS,
    VOLTS,
)

_UNIT = 20  # characters of a unit; longer ones do not count
_WEIGHT = {"g": "gf", "kg": "kgf", "lb": "lbf", "mg": "mgf"}  # a load cell that was calibrated with masses
_ALIASES = {
    "sec.": "s",
    "msec": "ms",
    "usec": "us",
    "nsec": "ns",
    "gm": "g",
    "gr": "g",
    "grf": "gf",
    "kp": "kgf",
    "lbs": "lb",
    '"': "in",
}
_BEHIND = re.compile(r"(?:\s*/\s*|,\s*|\s+in\s+)(\S{1,20})")  # "Force / N", "Force, N", "Force in N"
_AFTER_SPACE = {"N", "mN", "kN", "uN", "µN", "nN", "kgf", "gf", "lbf", "mm", "um", "µm", "nm", "ms", "sec", "mm/s"}
_SPLIT = re.compile(r"(.*?)(nano|n)?secs?(?:ond|onds)?", re.IGNORECASE)
_IN_BRACKETS = re.compile(r"[\[(][^\])]*[\])]?")
_WORD = re.compile(r"[^\W\d_]+")
_OF_JOINTS = re.compile(r"(?:.*[^a-z])?(?:position|pos|velocity|vel|effort)\[\d+\]", re.IGNORECASE)
_ADJECTIVES = {
    "raw",
    "left",
    "right",
    "abs",
    "abs.",
    "rel",
    "rel.",
    "up",
    "down",
    "top",
    "z",
    "x",
    "y",
    "avg",
    "mean",
    "-",
}
_DEPTHS = {"indentation", "penetration", "depth", "eindringtiefe", "tiefe"}
_FORCES = {word for word, role in BY_WORD.items() if role == "force"} | {"f"}
_BACK = {"retract", "retraction", "retracting", "unload", "unloading", "withdraw", "withdrawal", "retrace", "return"}
_WAYS_OF_NANOSCOPE = re.compile(r"_(?:Ex|(Rt))(?=_|$)")  # extend and retract, in "Calc_Ramp_Ex_nm" and "Defl_nN_Rt"


def words_of(name: str) -> list[str]:
    """Return the words of a name in small letters, without its unit.

    >>> words_of("actual_TCP_force_2 [N]")
    ['actual', 'tcp', 'force']
    """
    return [word.lower() for word in _WORD.findall(_IN_BRACKETS.sub(" ", name))]


def bare_name(name: str) -> str:
    """Return a name in small letters without its unit.

    >>> bare_name("Fz [N]"), bare_name("tcp_z_mm"), bare_name("Force_Z")
    ('fz', 'tcp_z', 'force_z')
    """
    bare = _IN_BRACKETS.sub(" ", name).strip()
    unit = unit_text(bare)
    return (re.sub(rf"[\s_/,]+(in\s+)?{re.escape(unit)}$", "", bare) if unit and is_unit(unit) else bare).lower()


def stamp_parts(names: Sequence[str]) -> dict[str, int]:
    """Which columns are the seconds of a stamp (``whole``) and its nanoseconds (``nano``), of those that are split.

    >>> stamp_parts(["header.stamp.sec", "header.stamp.nanosec", "force"]), stamp_parts(["sec", "force"])
    ({'whole': 0, 'nano': 1}, {})
    """
    found = [(k, match) for k, name in enumerate(names) if (match := _SPLIT.fullmatch(name.strip()))]
    nano = next(((k, match) for k, match in found if match[2]), None)
    if nano is None:
        return {}
    whole = next((k for k, match in found if not match[2] and match[1] == nano[1][1]), None)
    return {"nano": nano[0]} if whole is None else {"whole": whole, "nano": nano[0]}


def exact_role(name: str) -> str | None:
    """Return the role that a whole name states, and of names within groups a time.

    >>> exact_role("Fz"), exact_role("force.time"), exact_role("tool.z")
    ('force', 'time', None)
    """
    *groups, last = name.strip().lower().split(".")
    role = next((role for role, words in EXACT.items() if last in words), None)
    return role if not groups or role == "time" else None


def role_by_words(name: str) -> str | None:
    """Return the role that a word of a name states; "other" if none does."""
    roles = _roles_of_words(name)
    return "other" if "other" in roles or is_of_joints(name) else next(iter(roles), None)


def is_another_quantity(name: str) -> bool:
    """Return True if a word of a name excludes a height, also in a unit of length, as of a gripper's width.

    >>> is_another_quantity("gripper_width_mm"), is_another_quantity("joint_2_mm")
    (True, False)
    """
    return "other" in _roles_of_words(name)


def is_spread(name: str) -> bool:
    """Return True if a name states the scatter of a quantity, which has the unit of that, and not the quantity.

    >>> is_spread("force std (N)"), is_spread("force mean (N)")
    (True, False)
    """
    return bool(SPREADS & {*words_of(name)})


def _roles_of_words(name: str) -> list[str]:
    """Return the roles that the words of a name state, without the suffix of a reading such as "_counts".

    Of a list of forces and torques, as in "raw_force_torque_2", the first three elements are forces.
    """
    stem, _, unit = name.strip().rpartition("_")
    words = words_of(stem if unit in READINGS else name)
    if (element := _OF_WRENCH.search(name)) is not None:
        return ["force" if int(element[1]) < 3 else "other"]
    return [BY_WORD[word] for word in words if word in BY_WORD]


_OF_WRENCH = re.compile(r"force_?torque[_.\[ ]*([0-5])\]?$", re.IGNORECASE)


def is_of_joints(name: str) -> bool:
    """Return True if a name without a unit is that of an angle, a torque or an element of a list of joints.

    >>> [is_of_joints(name) for name in ("joint_2", "tau_ext_2", "position[2]", "tcp_position[2]", "Fz")]
    [True, True, True, False, False]
    """
    words = {*words_of(name)}
    return bool(words & ANGULAR) or (_OF_JOINTS.fullmatch(name.strip()) is not None and not words & CARTESIAN)


def symbol_role(name: str) -> str | None:
    """Return the role of the usual symbol in a name, as in "<F>" or "d_mean"; None where more is in it.

    >>> symbol_role("<F>"), symbol_role("d_mean"), symbol_role("specimen d")
    ('force', 'position', None)
    """
    words = [word for word in words_of(name) if word not in QUALIFIERS]
    return SYMBOLS.get(words[0]) if len(words) == 1 else None


def stated_role(name: str) -> str | None:
    """Return the role that a name states as a whole, by a word or by its symbol; "other" if none does."""
    return exact_role(name) or role_by_words(name) or symbol_role(name)


def contradicts(name: str, role: str) -> bool:
    """Return True if the words of a name state a force where its unit states a position, or the reverse.

    >>> contradicts("Load (mm)", "position"), contradicts("Load displacement (mm)", "position")
    (True, False)
    """
    roles = {BY_WORD.get(word) for word in words_of(name) if word not in EITHER}
    return role not in roles and bool(roles & ({"force", "position"} - {role}))


def is_reading(name: str) -> bool:
    """Return True if a name without a unit is that of counts or volts, of which only a person knows how much one is.

    >>> is_reading("motor_position"), is_reading("loadcell_raw"), is_reading("force_raw")
    (True, True, False)
    """
    words = words_of(name)
    in_volts = len(words) > 1 and words[-1] in VOLTS
    return in_volts or bool(READERS & {*words}) or ("raw" in words and bool(CELLS & {*words}))


def is_depth(name: str) -> bool:
    """Return True if a name states the depth itself, which other columns only resemble."""
    return bool(_DEPTHS & {*words_of(name)})


def is_of_retraction(name: str) -> bool:
    """Return True if a column holds the way back alone.

    >>> is_of_retraction("Force retract (nN)"), is_of_retraction("Defl_nN_Rt"), is_of_retraction("Force RT")
    (True, True, False)
    """
    match = _WAYS_OF_NANOSCOPE.search(name)
    return bool(_BACK & {*words_of(name)} or (match and match[1]))


def begins_as_time(name: str) -> bool:
    """Return True if the first word of a name is one of time."""
    words = words_of(name)
    return bool(words) and ("time" in (exact_role(name), BY_WORD.get(words[0])) or words[0] in EXACT["time"])


def unit_text(name: str) -> str:
    """Return the text in the last brackets of a name, or behind its last ``_``, ``/``, comma, "in" or space, or "".

    >>> unit_text("Defl_nN_Ex"), unit_text("Calc_Ramp_Ex_nm"), unit_text("Force / N")
    ('nN', 'nm', 'N')
    """
    name = name.strip()
    if name[-1:] in ("]", ")"):
        begin = max(name.rfind("["), name.rfind("("))
        unit = name[begin + 1 : -1].strip() if begin >= 0 else ""
        return unit.replace("_s", "/s").replace("^-1", "") if len(unit) <= _UNIT else ""
    name = _WAYS_OF_NANOSCOPE.sub("", name)
    for unit in (part for part in ("_".join(name.split("_")[-2:]), name.rpartition("_")[2]) if "_" in name):
        usable = unit.replace("_", "/") if "_" in unit else unit
        if len(name) > len(unit) + 1 and len(unit) <= _UNIT and (is_unit(usable) or unit in READINGS):
            return usable
    behind = list(_BEHIND.finditer(name))
    if behind and behind[-1].end() == len(name):
        return behind[-1][1]
    stem, _, last = name.rpartition(" ")
    has_role = any(BY_WORD.get(word, "other") != "other" for word in words_of(stem))  # "Force N", and not "Cycle N"
    return last if last in _AFTER_SPACE and has_role else ""


def plain_unit(text: str) -> str:
    """Return a unit without brackets and quotes, as palpate writes it, where it is one.

    >>> plain_unit("[Sec]"), plain_unit('"mm"'), plain_unit("(µm)")
    ('sec', 'mm', 'µm')
    """
    text = text.strip().strip("\"'").strip()
    text = text[1:-1].strip() if len(text) > 2 and text[0] + text[-1] in ("[]", "()", "{}", "<>") else text
    forms = (text, _ALIASES.get(text.lower(), ""), text.lower() if len(text) > 2 or text in ("MM", "S") else "")
    return next((form for form in forms if form and _known(form)), text)


def is_unit(text: str) -> bool:
    """Return True if a text is a unit that a column can have."""
    return _known(plain_unit(text))


@cache
def _known(text: str) -> bool:
    try:
        return bool(text) and len(text) <= _UNIT and text != "1" and bool(si_unit(text))
    except ValueError:
        return text in _WEIGHT


def unit_of(name: str, below: str = "") -> str | None:
    """Return the unit of a column by its name or the row of units `below` it; a load in grams is in gf; None for
    none."""
    unit = plain_unit(below) if below else plain_unit(unit_text(name))
    if _FORCES & {*words_of(name)}:
        unit = _WEIGHT.get(unit, unit)
    try:
        return unit if unit and unit != "1" and si_unit(unit) else None
    except ValueError:
        return None


def weight_of(unit: str) -> str | None:
    """Return the force that a mass in a unit weighs; None where it is not a mass."""
    return _WEIGHT.get(plain_unit(unit))


def is_electrical(unit: str) -> bool:
    """Return True if a unit is that of an amplifier or a converter, of which only a person knows what it stands for."""
    return plain_unit(unit).lower() in ELECTRICAL


def looks_like_unit(written: str, name: str) -> bool:
    """Return True if a short text in brackets or in a row of units must be a unit, known or not."""
    bracketed = name.strip()[-1:] in ("]", ")") or not name.strip().endswith(written)
    short = 0 < len(written) <= 5 and not any(c in written for c in " %") and not written.isdigit()
    return bracketed and short and weight_of(written) is None and written.lower() not in _ADJECTIVES
