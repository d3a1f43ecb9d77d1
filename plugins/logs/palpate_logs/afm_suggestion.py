"""The pipeline that `info` suggests for a force curve, and what of it a person must state or check."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from palpate import LogError
from palpate_kit.logs.suggestion import TIP
from palpate_records.recording import Suggestion

from palpate_logs.curve_file import CurveFile, curve_file, named_curve
from palpate_logs.force_curve import TIP_POSITION, ForceCurve

ANALYSIS = "afm-analysis"  # the template of tip, model and estimator
_CHANNELS = {"force": "force", "position": "height", "measuring": "approach"}  # of the device, by role
_MAX_TARE_SHARE = 0.3  # of the approach, its first part, whose mean is the tare; a choice: contact begins later
_DURATION_DIGITS = (5.0, 2.0, 1.0)  # of a tare's duration: curves of a map, which differ a little, share it (0593)
_DURATION_ROUNDING = 1e-9  # relative; a choice, over the rounding of a double: 5 s computed as 4.999... s stays 5 s


def suggest_curve(path: Path, choices: Mapping[str, str]) -> Suggestion:
    """Return the tables that read a force curve; of a map the chosen or the first curve. Raises LogError.

    A person must state the rate if the file contains no time, and the spring constant if the file does not state it.
    """
    file = curve_file(path)
    curve = _sound_curve(file, path, choices.get("record"))
    has_time = curve.time() is not None
    device, blanks = _device_table(path, curve, choices, has_time)
    alignment: dict[str, Any] = {role: {"channel": f"log.{channel}"} for role, channel in _CHANNELS.items()}
    reasons = [f"force and height: those of {curve.name.removeprefix(f'{path}: ')}, as the format names them"]
    if curve.spring_constant is not None:
        reasons.append(f"spring constant: {curve.spring_constant:.4g} N/m, as the file states it")
    reasons.append("measuring: the way in, as the file has it")
    if has_time and curve.approach_duration is not None:
        alignment["tare_duration"] = f"{_round_down(_MAX_TARE_SHARE * curve.approach_duration):.3g} s"
        reasons.append(
            f"tare: the mean of up to {_MAX_TARE_SHARE:.0%} of the approach, its first, which has to be in air"
        )
    alignment["tip_mass"] = "0 g"
    return Suggestion(
        device=device,
        alignment=alignment,
        reasons=tuple(reasons),
        doubts=tuple(_doubts(file, choices)),
        blanks=tuple(blanks),
        template=ANALYSIS,
        assumed=("model.*", "alignment.tare", "alignment.*.delay"),
        has_time=has_time,
    )


def _device_table(
    path: Path, curve: ForceCurve, choices: Mapping[str, str], has_time: bool
) -> tuple[dict[str, Any], list[str]]:
    """Return the table of the device that reads a curve, and a sentence for each of its keys that is left blank."""
    device: dict[str, Any] = {"type": "afm-replay", "file": str(path)}
    blanks: list[str] = []
    if "record" in choices:
        device["record"] = choices["record"]
    if not has_time:
        device["rate"] = choices.get("rate", "? Hz")
        if "rate" not in choices:
            blanks.append("rate: the file contains no time (or --rate '2 kHz')")
    # The height of the tip is a column, or follows from the spring constant.
    if curve.spring_constant is None and TIP_POSITION not in curve.columns:
        device["spring_constant"] = "? N/m"
        blanks.append("spring_constant: the file does not state it")
    return device, blanks


def _doubts(file: CurveFile, choices: Mapping[str, str]) -> list[str]:
    """Return the sentences on what a person should check: which curve of a map is read, and the tip."""
    doubts: list[str] = []
    if len(file.numbers) > 1 and "record" not in choices:
        doubts.append(
            f"the file holds {len(file.numbers)} curves, and the first is read: --set device.log.record=NUMBER"
        )
    if TIP not in choices:
        doubts.append("the tip: the file does not state its shape and size; state them in [indenter.tip]")
    return doubts


def _round_down(seconds: float) -> float:
    """Return the longest duration [s] of 1, 2 or 5 times a power of ten that is not longer than one in seconds."""
    power = 10.0 ** math.floor(math.log10(seconds))
    limit = seconds * (1 + _DURATION_ROUNDING)
    return next((digit * power for digit in _DURATION_DIGITS if digit * power <= limit), power)


def _sound_curve(file: CurveFile, path: Path, name: str | None) -> ForceCurve:
    """Return the curve of a name; if it is damaged, the first sound curve of the map.

    A map whose first curve is damaged gets a suggestion all the same. Raises LogError if every curve is damaged, and
    for a name that is not a number.
    """
    try:
        return named_curve(file, path, name)
    except LogError:
        is_number = name is None or name.isdecimal()
        if len(file.numbers) == 1 or not is_number:
            raise
        for number in file.numbers:
            try:
                return file.curve(number)
            except LogError:
                continue
        raise
