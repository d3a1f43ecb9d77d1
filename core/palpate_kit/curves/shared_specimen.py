"""Two tips, or two depths, on one specimen: E_n of what they give, which shows a wrong fact of rig or specimen.

A material with memory hides a wrong fact from one record. Another tip or depth weighs a layer, a tip or a base
differently, so that values that hold for the same facts agree only where these are right.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from palpate import Indenter
from palpate_engine import Pipeline, Registry, numbers_of

from palpate_kit.curves.curve_pipelines import dialect_pipeline
from palpate_kit.curves.curve_row import CurveRow
from palpate_kit.curves.fit_folder import FitFolder
from palpate_kit.numerics.normalised_error import normalised_error
from palpate_kit.terminal.phrase import Quantity, curve_count, quantity_text

SPECIMEN = "specimen"  # column of ``curves.csv``
COMPARED = ("elasticity", "viscosity")  # else the first two values of a model
DEEPER = 1.25  # times as deep is another depth; a choice, far above the noise of a depth
AGREEMENT = 1.0  # of E_n (ISO 13528)


@dataclass(frozen=True)
class Setup:
    """The records of one specimen by one tip to about one depth, with their means."""

    tip: str
    deepest: float | None  # [m]
    curves: tuple[str, ...]
    values: Mapping[str, tuple[float, float]]  # by name, with the combined uncertainty [SI]

    @property
    def words(self) -> str:
        """As in "exact-sphere 2.5 mm, 3.4 mm deep"."""
        depth = "" if self.deepest is None else f"{quantity_text(Quantity(self.deepest, 'm', 2))} deep"
        count = curve_count(len(self.curves)) if len(self.curves) > 1 else ""
        return ", ".join(filter(None, (self.tip, depth, count)))

    @property
    def table(self) -> dict[str, Any]:
        """As plain data [SI]."""
        values = {name: {"value": value, "combined": combined} for name, (value, combined) in self.values.items()}
        return {"tip": self.tip, "deepest": self.deepest, "curves": [*self.curves], "values": values}


@dataclass(frozen=True)
class SetupPair:
    """Two setups on one specimen, with E_n of each value that both have."""

    specimen: str
    track: str
    setups: tuple[Setup, Setup]
    e_n: Mapping[str, float]

    @property
    def beyond(self) -> list[str]:
        """Names of the values that do not agree."""
        return [name for name, score in self.e_n.items() if score > AGREEMENT]

    @property
    def table(self) -> dict[str, Any]:
        """As plain data [SI]."""
        setups = [setup.table for setup in self.setups]
        return {"specimen": self.specimen, "track": self.track, "setups": setups, "e_n": dict(self.e_n)}


def setup_pairs(folder: FitFolder, curves: Collection[str], known: Registry) -> list[SetupPair]:
    """Return the pairs of tips or depths on each specimen of some curves, those that agree least first."""
    if SPECIMEN not in folder.columns:
        return []
    names = [name for name in COMPARED if name in folder.values] or folder.values[:2]
    pairs = []
    for (specimen, track), of_tip in _rows_by_tip(folder, curves).items():
        setups = [
            _setup(short_tip(tip, known), same_depth, names)
            for tip, of_one in of_tip.values()
            for same_depth in by_depth(of_one)
        ]
        pairs += [SetupPair(specimen, track, pair, _scores(*pair)) for pair in combinations(setups, 2)]
    return sorted((pair for pair in pairs if pair.e_n), key=lambda pair: -max(pair.e_n.values()))


_RowsOfTip = tuple[Indenter | None, list[CurveRow]]


def _rows_by_tip(folder: FitFolder, curves: Collection[str]) -> dict[tuple[str, str], dict[str, _RowsOfTip]]:
    """Return the usable rows of some curves by specimen and track, then by their tips."""
    of_specimen: dict[tuple[str, str], dict[str, _RowsOfTip]] = {}
    pipelines: dict[tuple[str, tuple[str, ...]], Pipeline] = {}
    for name in curves:
        if name not in folder.by_curve:
            continue
        kind = folder.dialect_of(name), folder.settings_of(name)
        for row in folder.rows_of(name):
            if not (row.usable and row.current and row.groups.get(SPECIMEN)):
                continue
            if kind not in pipelines:
                pipelines[kind] = dialect_pipeline(folder, *kind)
            tip = _tip_of(pipelines[kind], row.track)
            of_tip = of_specimen.setdefault((row.groups[SPECIMEN], row.track), {})
            of_tip.setdefault(repr(tip), (tip, []))[1].append(row)
    return of_specimen


def _tip_of(pipeline: Pipeline, name: str) -> Indenter | None:
    """Return the tip of a track; None where its model has none."""
    track = next(track for track in pipeline.tracks if str(track.name) == name)
    tip = getattr(track.model, "indenter", None)
    return tip if isinstance(tip, Indenter) else None


def by_depth(rows: Sequence[CurveRow]) -> list[list[CurveRow]]:
    """Return rows in groups of about the same depth, from the least deep on."""
    groups: list[list[CurveRow]] = []
    shallowest = 0.0
    for depth, row in sorted(((row.number("deepest") or 0.0, row) for row in rows), key=lambda item: item[0]):
        if groups and depth <= DEEPER * shallowest:
            groups[-1].append(row)
        else:
            groups.append([row])
            shallowest = depth
    return groups


def short_tip(tip: Indenter | None, known: Registry) -> str:
    """Return a tip by its kind and numbers, as in "exact-sphere 2.5 mm"; empty without one."""
    if tip is None:
        return ""
    numbers = (quantity_text(Quantity(value, unit)) for _, value, unit in numbers_of(tip))
    return " ".join([known.name_of(type(tip)), *numbers])


def _setup(tip: str, rows: Sequence[CurveRow], names: Sequence[str]) -> Setup:
    """Return the means of repeats; their uncertainty is that of one, since what they share does not average out."""
    values = {}
    for name in names:
        cells = [(row.usable_number(name), row.number(f"{name}_combined")) for row in rows]
        known = [(value, combined) for value, combined in cells if value is not None and combined]
        if known:
            value, combined = np.mean(known, axis=0).tolist()
            values[name] = (value, combined)
    depths = [depth for row in rows if (depth := row.number("deepest")) is not None]
    return Setup(tip, max(depths, default=None), tuple(row.curve for row in rows), values)


def _scores(one: Setup, other: Setup) -> dict[str, float]:
    """Return the magnitude of E_n of each value that both have."""
    shared = [name for name in one.values if name in other.values]
    return {name: abs(normalised_error(*one.values[name], *other.values[name])) for name in shared}


def agreement_sentence(pairs: Sequence[SetupPair]) -> str:
    """Return what the pairs say of the facts of rig and specimen; empty without any."""
    if not pairs:
        return ""
    beyond = [pair for pair in pairs if pair.beyond]
    if not beyond:
        return "E_n is at most 1: the stated facts of rig and specimen agree within the ±"
    several = f" in {len(beyond)} of {len(pairs)} pairs" if len(pairs) > 1 else ""
    elastic = any(name != "viscosity" for pair in beyond for name in pair.beyond)
    likely = "tip, thickness or base" if elastic else "the delay"
    specimens = ", ".join(dict.fromkeys(pair.specimen for pair in beyond))
    wrong = "a fact of rig or specimen is wrong for at least one of them"
    return f"E_n is beyond 1{several} ({specimens}): {wrong}, most likely {likely}"
