"""Two tips, or two depths, on one specimen: the E_n of their values shows a wrong fact of rig or specimen.

In one record of a material with memory a wrong fact may not show. Another tip or depth weighs a layer, a tip or a base
differently, so that the values of both agree only if the facts are right.
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
DEEPER = 1.25  # ratio of two depths that are different: far above the noise of a depth; a choice
AGREEMENT = 1.0  # E_n up to which two values agree (ISO 13528)


@dataclass(frozen=True)
class Setup:
    """The curves of one specimen by one tip to about one depth, with the means of their values."""

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


def setup_pairs(folder: FitFolder, curves: Collection[str], registry: Registry) -> list[SetupPair]:
    """Return the pairs of setups on each specimen of some curves, in the order of their largest E_n."""
    if SPECIMEN not in folder.columns:
        return []
    names = [name for name in COMPARED if name in folder.values] or folder.values[:2]
    pairs = []
    for (specimen, track), rows_by_tip in _rows_by_tip(folder, curves).items():
        # A setup for each tip and depth on the specimen.
        setups = []
        for tip, rows in rows_by_tip.values():
            tip_text = short_tip(tip, registry)
            setups += [_mean_setup(tip_text, rows_of_depth, names) for rows_of_depth in by_depth(rows)]
        pairs += [SetupPair(specimen, track, pair, _scores(*pair)) for pair in combinations(setups, 2)]
    return sorted((pair for pair in pairs if pair.e_n), key=lambda pair: -max(pair.e_n.values()))


_RowsOfTip = tuple[Indenter | None, list[CurveRow]]


def _rows_by_tip(folder: FitFolder, curves: Collection[str]) -> dict[tuple[str, str], dict[str, _RowsOfTip]]:
    """Return the usable rows of some curves with the present settings, by (specimen, track), then by the tip's text.

    An entry is the tip and its rows.
    """
    rows_by_specimen: dict[tuple[str, str], dict[str, _RowsOfTip]] = {}
    pipelines: dict[tuple[str, tuple[str, ...]], Pipeline] = {}
    for name in curves:
        if name not in folder.by_curve:
            continue
        dialect_and_settings = folder.dialect_of(name), folder.settings_of(name)
        for row in folder.rows_of(name):
            if not (row.usable and row.current and row.groups.get(SPECIMEN)):
                continue
            # A pipeline is built once for all curves with the same settings.
            if dialect_and_settings not in pipelines:
                pipelines[dialect_and_settings] = dialect_pipeline(folder, *dialect_and_settings)
            tip = _tip_of(pipelines[dialect_and_settings], row.track)
            rows_by_tip = rows_by_specimen.setdefault((row.groups[SPECIMEN], row.track), {})
            _, rows = rows_by_tip.setdefault(repr(tip), (tip, []))
            rows.append(row)
    return rows_by_specimen


def _tip_of(pipeline: Pipeline, name: str) -> Indenter | None:
    """Return the tip of a track; None if its model has none."""
    track = next(track for track in pipeline.tracks if str(track.name) == name)
    tip = getattr(track.model, "indenter", None)
    return tip if isinstance(tip, Indenter) else None


def by_depth(rows: Sequence[CurveRow]) -> list[list[CurveRow]]:
    """Return rows in groups of about the same depth, the shallowest first; each begins at its own shallowest row."""
    groups: list[list[CurveRow]] = []
    shallowest = 0.0
    depths_and_rows = ((row.number("deepest") or 0.0, row) for row in rows)
    for depth, row in sorted(depths_and_rows, key=lambda item: item[0]):
        if groups and depth <= DEEPER * shallowest:
            groups[-1].append(row)
        else:
            groups.append([row])
            shallowest = depth
    return groups


def short_tip(tip: Indenter | None, registry: Registry) -> str:
    """Return a tip by its kind and numbers, as in "exact-sphere 2.5 mm"; empty without one."""
    if tip is None:
        return ""
    numbers = (quantity_text(Quantity(value, unit)) for _, value, unit in numbers_of(tip))
    return " ".join([registry.name_of(type(tip)), *numbers])


def _mean_setup(tip: str, rows: Sequence[CurveRow], names: Sequence[str]) -> Setup:
    """Return the means of repeats and of their combined uncertainties: errors that repeats share do not average out."""
    values = {}
    for name in names:
        numbers = [(row.usable_number(name), row.number(f"{name}_combined")) for row in rows]
        usable_numbers = [(value, combined) for value, combined in numbers if value is not None and combined]
        if usable_numbers:
            value, combined = np.mean(usable_numbers, axis=0).tolist()
            values[name] = (value, combined)
    depths = [depth for row in rows if (depth := row.number("deepest")) is not None]
    return Setup(tip, max(depths, default=None), tuple(row.curve for row in rows), values)


def _scores(first: Setup, second: Setup) -> dict[str, float]:
    """Return the magnitude of E_n of each value that both have."""
    names = [name for name in first.values if name in second.values]
    return {name: abs(normalised_error(*first.values[name], *second.values[name])) for name in names}


def agreement_sentence(pairs: Sequence[SetupPair]) -> str:
    """Return a sentence on the facts of rig and specimen by the agreement of pairs; empty without any."""
    if not pairs:
        return ""
    beyond = [pair for pair in pairs if pair.beyond]
    if not beyond:
        return "E_n is at most 1: the stated facts of rig and specimen agree within the ±"
    pair_count = f" in {len(beyond)} of {len(pairs)} pairs" if len(pairs) > 1 else ""
    # A wrong tip, thickness or base changes every value; a wrong delay mostly the viscosity.
    is_elastic = any(name != "viscosity" for pair in beyond for name in pair.beyond)
    likely_fact = "tip, thickness or base" if is_elastic else "the delay"
    specimens = ", ".join(dict.fromkeys(pair.specimen for pair in beyond))
    conclusion = "a fact of rig or specimen is wrong for at least one of them"
    return f"E_n is beyond 1{pair_count} ({specimens}): {conclusion}, most likely {likely_fact}"
