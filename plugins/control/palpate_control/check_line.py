"""The line of a result on the latest check of its rig."""

from __future__ import annotations

from datetime import datetime

from palpate_engine import Result

_DAY, _HOUR = 86400.0, 3600.0  # [s]


def check_lines(result: Result) -> list[str]:
    """Return one line for a run with ``[run] control``: ``control: E_n 0.40 on 2026-11-20, 3 days old, in control``."""
    check = result.run.get("control")
    if not check:
        return []
    state = "in control" if check["in_control"] else "out of control"
    old = ", older than [run] control_valid allows" if check["old"] else ""
    date = datetime.fromisoformat(check["date"])
    return [f"control: E_n {check['e_n']:.2f} on {date:%Y-%m-%d}, {age_text(check['age'])}{old}, {state}"]


def age_text(age: float) -> str:
    """Return an age [s] in words.

    >>> age_text(3 * 86400.0), age_text(7200.0), age_text(-1.0)
    ('3 days old', '2 hours old', 'made after the run')
    """
    if age < 0:
        return "made after the run"
    if age < _HOUR:
        return "of this hour"
    number, unit = (age / _DAY, "day") if age >= _DAY else (age / _HOUR, "hour")
    return f"{number:.0f} {unit}{'' if round(number) == 1 else 's'} old"
