"""What the product says of a record, as plain data for the matrix."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import palpate

from verdict_records.rigs import Rig

_FACTS = {
    "half_space_above": "thickness",
    "rigid_above": "mount",
    "level_within": "level",
    "flat_above": "flat",
}
# Flags by which a record contradicts its model, whatever that moves.
_OF_THE_RECORD = (
    "lack-of-fit",
    "model-discrepancy",
    "tare-unclear",
    "outliers",
    "pull-off",
    "unloading",
    "surface-mismatch",
    "delay-unclear",
)
_VALUES = ("elasticity", "viscosity")


def judged(path: Path, rig: Rig, stated: bool) -> dict[str, Any]:
    """The fit of a file, with everything stated or with the tip only."""
    facts: dict[str, Any] = {}
    model: Any = "dr"
    if stated:
        delays = dict.fromkeys(("force", "height", *(["velocity"] if rig.speed_noise is not None else [])), "0 ms")
        tare = "none" if path.stem.startswith("cut") else "free-air"
        facts = {"timing": "0.2 ms", "delay": delays, "tip_mass": f"{1e3 * rig.mass:g} g", "tare": tare}
        model = _model(rig)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            record = palpate.read(path, **facts)
            found = palpate.fit(record, model=model, tip=None if stated else rig.tip_words)
    except palpate.PalpateError as error:
        return {"refused": str(error).splitlines()[0]}
    return told_by(found.track.document)


def _model(rig: Rig) -> Any:
    from palpate_models import Cone, DimensionalityReduction, ExactSphere, Flat, Paraboloid

    tips: dict[str, Any] = {
        "paraboloid": lambda: Paraboloid(curvature_radius=rig.size),
        "sphere": lambda: ExactSphere(radius=rig.size),
        "flat": lambda: Flat(radius=rig.size),
        "cone": lambda: Cone(angle=rig.size),
    }
    return DimensionalityReduction(indenter=tips[rig.tip](), thickness="half-space")


def told_by(track: Mapping[str, Any]) -> dict[str, Any]:
    """Verdicts, values, findings, conditions and facts of a track's document."""
    findings = [flag for flag in track["flags"] if flag["severity"] in ("doubtful", "invalid")]
    said: dict[str, Any] = {"verdict": "good" if track["verdict"] == "note" else track["verdict"]}
    for name in _VALUES:
        value = track["parameters"][name]
        number = value.get("value")
        word = value.get("verdict") or said["verdict"]
        said[name] = {
            "value": value.get("estimate") if number is None else number,
            "combined": value.get("combined"),
            "verdict": "good" if word == "note" else word,
        }
    notes = [flag for flag in track["flags"] if flag["severity"] == "note"]
    small = [flag for flag in (*track.get("immaterial", []), *notes) if flag["code"] in _OF_THE_RECORD]
    said["findings"] = [flag["code"] for flag in findings]
    said["immaterial"] = [flag["code"] for flag in small]
    said["words"] = " ".join(_words([*findings, *small])).lower()
    said["conditions"] = [one["fact"] for one in track.get("conditions", [])]
    said["facts"] = sorted({*said["conditions"], *_assumed(track)})
    return said


def _words(flags: list[dict[str, Any]]) -> Iterator[str]:
    for flag in flags:
        yield f"{flag['code']} {flag['message']}"
        yield from (f"{sign['code']} {sign['message']}" for sign in flag.get("evidence", []))


def _assumed(track: Mapping[str, Any]) -> Iterator[str]:
    """What is on the line of what is assumed exact."""
    table = track.get("diagnoses", {}).get("assumptions", {})
    yield from table.get("percent", {})
    yield from (fact for key, fact in _FACTS.items() if key in table)
