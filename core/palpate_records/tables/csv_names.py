"""The role and the unit of a column by its name."""

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

_MAX_UNIT = 20  # characters of a unit: a choice
_WEIGHTS = {"g": "gf", "kg": "kgf", "lb": "lbf", "mg": "mgf"}  # of a load cell that was calibrated with masses
_UNIT_ALIASES = {
    "sec.": "s", "msec": "ms", "usec": "us", "nsec": "ns", "gm": "g", "gr": "g", "grf": "gf", "kp": "kgf", "lbs": "lb",
    '"': "in",
}  # fmt: skip
_UNIT_BEHIND = re.compile(r"(?:\s*/\s*|,\s*|\s+in\s+)(\S{1,20})")  # "Force / N", "Force, N", "Force in N"
_UNITS_AFTER_SPACE = {
    "N", "mN", "kN", "uN", "µN", "nN", "kgf", "gf", "lbf", "mm", "um", "µm", "nm", "ms", "sec", "mm/s",
}  # fmt: skip
_STAMP_PART = re.compile(r"(.*?)(nano|n)?secs?(?:ond|onds)?", re.IGNORECASE)
_IN_BRACKETS = re.compile(r"[\[(][^\])]*[\])]?")
_WORD = re.compile(r"[^\W\d_]+")
_JOINT_ELEMENT = re.compile(r"(?:.*[^a-z])?(?:position|pos|velocity|vel|effort)\[\d+\]", re.IGNORECASE)
# Short texts in brackets that are not units.
_ADJECTIVES = {
    "raw", "left", "right", "abs", "abs.", "rel", "rel.", "up", "down", "top", "z", "x", "y", "avg", "mean", "-",
}  # fmt: skip
_DEPTH_WORDS = {"indentation", "penetration", "depth", "eindringtiefe", "tiefe"}
_FORCE_WORDS = {word for word, role in BY_WORD.items() if role == "force"} | {"f"}
_RETRACTION_WORDS = {
    "retract",
    "retraction",
    "retracting",
    "unload",
    "unloading",
    "withdraw",
    "withdrawal",
    "retrace",
    "return",
}
_NANOSCOPE_WAY = re.compile(r"_(?:Ex|(Rt))(?=_|$)")  # extend and retract, in "Calc_Ramp_Ex_nm" and "Defl_nN_Rt"


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
    """Return the columns of the seconds (``whole``) and nanoseconds (``nano``) of a stamp in two columns.

    >>> stamp_parts(["header.stamp.sec", "header.stamp.nanosec", "force"]), stamp_parts(["sec", "force"])
    ({'whole': 0, 'nano': 1}, {})
    """
    parts = [(k, match) for k, name in enumerate(names) if (match := _STAMP_PART.fullmatch(name.strip()))]
    nano_part = next(((k, match) for k, match in parts if match[2]), None)
    if nano_part is None:
        return {}
    # Both names have the same beginning.
    nano, nano_match = nano_part
    whole = next((k for k, match in parts if not match[2] and match[1] == nano_match[1]), None)
    return {"nano": nano} if whole is None else {"whole": whole, "nano": nano}


def exact_role(name: str) -> str | None:
    """Return the role that a whole name states; of the name of a member of a group only a time counts.

    >>> exact_role("Fz"), exact_role("force.time"), exact_role("tool.z")
    ('force', 'time', None)
    """
    *groups, last = name.strip().lower().split(".")
    role = next((role for role, names in EXACT.items() if last in names), None)
    return role if not groups or role == "time" else None


def role_by_words(name: str) -> str | None:
    """Return the role that a word of a name states; "other" for another quantity, None for an unknown name."""
    roles = _roles_of_words(name)
    return "other" if "other" in roles or is_of_joints(name) else next(iter(roles), None)


def is_another_quantity(name: str) -> bool:
    """Return True if a word of a name excludes a height even in a unit of length, as in a gripper's width.

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
    name_words = words_of(stem if unit in READINGS else name)
    if (element := _WRENCH_ELEMENT.search(name)) is not None:
        return ["force" if int(element[1]) < 3 else "other"]
    return [BY_WORD[word] for word in name_words if word in BY_WORD]


_WRENCH_ELEMENT = re.compile(r"force_?torque[_.\[ ]*([0-5])\]?$", re.IGNORECASE)


def is_of_joints(name: str) -> bool:
    """Return True if a name without a unit is that of an angle, a torque or an element of a list of joints.

    >>> [is_of_joints(name) for name in ("joint_2", "tau_ext_2", "position[2]", "tcp_position[2]", "Fz")]
    [True, True, True, False, False]
    """
    name_words = {*words_of(name)}
    return bool(name_words & ANGULAR) or (
        _JOINT_ELEMENT.fullmatch(name.strip()) is not None and not name_words & CARTESIAN
    )


def symbol_role(name: str) -> str | None:
    """Return the role of the usual symbol in a name, as in "<F>" or "d_mean"; None for a name with other words.

    >>> symbol_role("<F>"), symbol_role("d_mean"), symbol_role("specimen d")
    ('force', 'position', None)
    """
    name_words = [word for word in words_of(name) if word not in QUALIFIERS]
    return SYMBOLS.get(name_words[0]) if len(name_words) == 1 else None


def stated_role(name: str) -> str | None:
    """Return the role that a name states as a whole, by a word or by its symbol; "other" for another quantity."""
    return exact_role(name) or role_by_words(name) or symbol_role(name)


def contradicts(name: str, role: str) -> bool:
    """Return True if the words of a name state a force and not the `role` position, or the reverse.

    >>> contradicts("Load (mm)", "position"), contradicts("Load displacement (mm)", "position")
    (True, False)
    """
    roles = {BY_WORD.get(word) for word in words_of(name) if word not in EITHER}
    return role not in roles and bool(roles & ({"force", "position"} - {role}))


def is_reading(name: str) -> bool:
    """Return True if a name without a unit is that of counts or volts, whose scale only a person knows.

    >>> is_reading("motor_position"), is_reading("loadcell_raw"), is_reading("force_raw")
    (True, True, False)
    """
    name_words = words_of(name)
    is_in_volts = len(name_words) > 1 and name_words[-1] in VOLTS
    is_of_raw_cell = "raw" in name_words and bool(CELLS & {*name_words})
    return is_in_volts or bool(READERS & {*name_words}) or is_of_raw_cell


def is_depth(name: str) -> bool:
    """Return True if a name states the depth itself, and not a height or the way of an actuator."""
    return bool(_DEPTH_WORDS & {*words_of(name)})


def is_of_retraction(name: str) -> bool:
    """Return True if a column holds the retraction alone, by its name.

    >>> is_of_retraction("Force retract (nN)"), is_of_retraction("Defl_nN_Rt"), is_of_retraction("Force RT")
    (True, True, False)
    """
    match = _NANOSCOPE_WAY.search(name)
    return bool(_RETRACTION_WORDS & {*words_of(name)} or (match and match[1]))


def begins_as_time(name: str) -> bool:
    """Return True if the first word of a name is one of time."""
    name_words = words_of(name)
    return bool(name_words) and (
        "time" in (exact_role(name), BY_WORD.get(name_words[0])) or name_words[0] in EXACT["time"]
    )


def unit_text(name: str) -> str:
    """Return the text in the last brackets of a name, or behind its last ``_``, ``/``, comma, "in" or space, or "".

    >>> unit_text("Defl_nN_Ex"), unit_text("Calc_Ramp_Ex_nm"), unit_text("Force / N")
    ('nN', 'nm', 'N')
    """
    name = name.strip()
    if name[-1:] in ("]", ")"):
        begin = max(name.rfind("["), name.rfind("("))
        unit = name[begin + 1 : -1].strip() if begin >= 0 else ""
        return unit.replace("_s", "/s").replace("^-1", "") if len(unit) <= _MAX_UNIT else ""
    name = _NANOSCOPE_WAY.sub("", name)
    if (suffix := _unit_behind_underscore(name)) is not None:
        return suffix
    matches = list(_UNIT_BEHIND.finditer(name))
    if matches and matches[-1].end() == len(name):
        return matches[-1][1]
    stem, _, last = name.rpartition(" ")
    # "Force N" has a unit, and "Cycle N" has none.
    has_role = any(BY_WORD.get(word, "other") != "other" for word in words_of(stem))
    return last if last in _UNITS_AFTER_SPACE and has_role else ""


def _unit_behind_underscore(name: str) -> str | None:
    """Return the unit behind the last ``_`` of a name, or the last two as in "v_mm_s"; None without one."""
    if "_" not in name:
        return None
    for suffix in ("_".join(name.split("_")[-2:]), name.rpartition("_")[2]):
        unit = suffix.replace("_", "/")
        is_short = len(name) > len(suffix) + 1 and len(suffix) <= _MAX_UNIT
        if is_short and (is_unit(unit) or suffix in READINGS):
            return unit
    return None


def plain_unit(text: str) -> str:
    """Return a unit without brackets and quotes, as palpate writes it; any other text without these.

    >>> plain_unit("[Sec]"), plain_unit('"mm"'), plain_unit("(µm)")
    ('sec', 'mm', 'µm')
    """
    text = text.strip().strip("\"'").strip()
    if len(text) > 2 and text[0] + text[-1] in ("[]", "()", "{}", "<>"):
        text = text[1:-1].strip()
    # In small letters "Sec" is a unit; of short texts, "MN" and "Ms" are other units than "mn" and "ms".
    lower_text = text.lower() if len(text) > 2 or text in ("MM", "S") else ""
    forms = (text, _UNIT_ALIASES.get(text.lower(), ""), lower_text)
    return next((form for form in forms if form and _is_known_unit(form)), text)


def is_unit(text: str) -> bool:
    """Return True if a text is a unit that a column can have."""
    return _is_known_unit(plain_unit(text))


@cache
def _is_known_unit(text: str) -> bool:
    """Return True for a unit that palpate knows, and for a mass that stands for its weight."""
    try:
        return bool(text) and len(text) <= _MAX_UNIT and text != "1" and bool(si_unit(text))
    except ValueError:
        return text in _WEIGHTS


def unit_of(name: str, below: str = "") -> str | None:
    """Return the unit of a column by the row of units `below` its name, else by the name; None without one.

    A load in grams is in gf.
    """
    unit = plain_unit(below) if below else plain_unit(unit_text(name))
    if _FORCE_WORDS & {*words_of(name)}:
        unit = _WEIGHTS.get(unit, unit)
    try:
        return unit if unit and unit != "1" and si_unit(unit) else None
    except ValueError:
        return None


def weight_of(unit: str) -> str | None:
    """Return the unit of force that a unit of mass weighs; None for any other unit."""
    return _WEIGHTS.get(plain_unit(unit))


def is_electrical(unit: str) -> bool:
    """Return True if a unit is that of an amplifier or a converter, whose scale only a person knows."""
    return plain_unit(unit).lower() in ELECTRICAL


def looks_like_unit(written: str, name: str) -> bool:
    """Return True if a short text in the brackets of a name, or in a row of units, must be a unit, known or not."""
    stands_apart = name.strip()[-1:] in ("]", ")") or not name.strip().endswith(written)
    is_short_word = 0 < len(written) <= 5 and not any(mark in written for mark in " %") and not written.isdigit()
    return stands_apart and is_short_word and weight_of(written) is None and written.lower() not in _ADJECTIVES
