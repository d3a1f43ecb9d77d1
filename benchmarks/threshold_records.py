"""The records of `thresholds.py`, each fitted once, with a function that judges its result again without a fit."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import matrix
import mistakes
import palpate
import real_records
import verdicts
from laboratory.kinds import KINDS
from palpate_engine.config import Source, build_pipeline
from palpate_engine.pipeline import Result, pipeline_run, record_tracks, run_pipeline, tracks
from verdict_records.rigs import RIGS

SEED = 350  # of the records that are drawn
LABORATORY = ("nothing", "noise", "noise-coloured", "velocity-late", "jitter")  # of `mistakes.py`, by all estimators
FILTERS = ("dr/ekf", "dr/afekf", "dr/kinematic", "dr/smoother", "kv/ekf")  # of `matrix.py`
SWEEP = Path(__file__).parent.parent / "pipelines" / "sweep.toml"
Judge = Callable[[], Result]


def stored_records(folder: Path) -> Iterator[tuple[str, Judge]]:
    """Yield the records by name, each fitted once, with the function that judges its result again.

    Some of their files are looked at again for that: the folder stays until the last judgement.
    """
    latest: dict[str, Any] = {}
    diagnose, build = tracks.Tracks.results, record_tracks.build_result

    def keep_diagnosis(*arguments: Any, **keywords: Any) -> Any:
        latest["diagnose"] = partial(diagnose, *arguments, **keywords)
        return diagnose(*arguments, **keywords)

    def keep_judgement(*arguments: Any, **keywords: Any) -> Any:
        diagnose_again = latest["diagnose"]
        latest["judge"] = lambda: build(*arguments, **keywords | {"tracks": diagnose_again()})
        return build(*arguments, **keywords)

    # What a fit and a run call when their estimates are made, so that only this is done again.
    tracks.Tracks.results = keep_diagnosis  # type: ignore[method-assign, assignment]
    record_tracks.build_result = pipeline_run.build_result = keep_judgement  # type: ignore[attr-defined]
    for name, fit in _fits(folder):
        latest.clear()
        with suppress(OSError, palpate.PalpateError):  # a recording that is not there, a record that is refused
            fit()
        if "judge" in latest:
            yield name, latest["judge"]


def _fits(folder: Path) -> Iterator[tuple[str, Callable[[], Any]]]:
    """Yield the fit of each record, by its name."""
    for case in _verdict_cases():
        name = " ".join(str(case[key]) for key in ("row", "kind", "rig", "sigma", "stated") if key in case)
        yield name, partial(verdicts.measured, case, SEED, Path(tempfile.mkdtemp(dir=folder)))
    for kind in KINDS:
        if kind.name in LABORATORY:
            yield f"laboratory {kind.name}", partial(mistakes.measured, kind, 0)
    yield "filters", partial(matrix.matrix, 1, folder / "filters", list(FILTERS), "5 s")
    yield "sweep", partial(_run_sweep, folder / "sweep")
    shared = verdicts._shared() / "data"
    for name in real_records.POINTS:
        yield f"real {name}", partial(real_records.point, shared, name)
    for name in real_records.REPEATS:
        tip: Any = real_records.Sphere(radius=5e-3)
        yield (
            f"real {name}",
            partial(real_records.press, shared / "repeats" / f"{name}.csv.gz", tip, real_records.ZEROED),
        )
    for name in real_records.FOAMS:
        path = shared / "foam" / f"{name}.csv.gz"
        tip = real_records.Flat(radius=1e-2) if name.startswith("flat") else real_records.ExactSphere(radius=1e-2)
        yield f"real {name}", partial(real_records.press, path, tip, {"tare": "free-air"})


def _verdict_cases() -> Iterator[verdicts.Case]:
    """Yield every rig with right facts or with none in turn, every kind of wrong at one size in turn, and memory."""
    for i, rig in enumerate(RIGS):
        yield {"row": ("right", "nothing")[i % 2], "rig": rig, "number": 0}
    for i, case in enumerate(verdicts.cases(1, ("wrong",))):
        if i % 3 == i // 3 % 3:
            yield case
    yield from (case for case in verdicts.cases(1, ("memory",)) if not case["kind"])
    yield from (case for case in verdicts.cases(1, ("real",)) if not case["stated"])


def _run_sweep(folder: Path) -> None:
    """Run the shorter half of the sweep of the examples, without its sink."""
    source = Source(SWEEP.read_text(), SWEEP)
    source.tables.pop("sink")
    source.tables["run"]["tracks"] = ["dr/kinematic", "dr/smoother"]
    source.tables["trajectory"]["sweep"] |= {"end": ["0 mm", "0 mm"], "settle": "4 s"}
    run_pipeline(build_pipeline(source), folder)
