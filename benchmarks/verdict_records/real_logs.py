"""The public point logs, with delays and thickness stated and with nothing but the tip."""

from __future__ import annotations

import gzip
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import palpate

from verdict_records.judgement import told_by

REAL = {  # file: radius of the tip, lateness [ms] of motion and of force, E [Pa] by the dynamometer
    "d10mm_soft": ("5 mm", "22 ms", "0 ms", 112.5e3),
    "d10mm_sphere": ("5 mm", "22 ms", "0 ms", None),
    "d5mm_soft": ("2.5 mm", "0 ms", "12 ms", 112.5e3),
}
_LAYER = {"law": "dimitriadis", "height": "22 mm", "bonded": False}


def judged_log(path: Path, case: Mapping[str, Any]) -> dict[str, Any]:
    """The fit of a log; `absent` where it is not there."""
    from palpate_models import DimensionalityReduction, ExactSphere

    if not path.exists():
        return {"absent": True}
    radius, motion, force, truth = REAL[case["kind"]]
    with gzip.open(path) as file:
        table = np.loadtxt(file, delimiter=",")
    z, v, f = 1e-3 * table[:, 0], -1e-3 * table[:, 3], table[:, 4]
    facts: dict[str, Any] = {}
    if case["stated"]:
        delays = {"height": motion, "velocity": motion, "force": force}
        facts = {"timing": "0.5 ms", "delay": delays, "tip_mass": "140 g", "alignment": {"tare_uncertainty": "50 mN"}}
    layer: Any = {"thickness": _LAYER} if case["stated"] else {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        record = palpate.record(rate="500 Hz", force=f, height=z, velocity=v, tare="0 N", **facts)
        found = palpate.fit(record, model=DimensionalityReduction(indenter=ExactSphere(radius=radius), **layer))
    return {"truth": {"elasticity": truth, "viscosity": None}} | told_by(found.track.document)
