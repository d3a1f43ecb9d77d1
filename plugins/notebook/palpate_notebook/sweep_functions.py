"""Many runs of one pipeline with settings changed, on all cores."""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from palpate import ConfigurationError, OutputError, PalpateError
from palpate_engine import StoppedError
from palpate_kit.jobs.cores import on_all_cores
from palpate_kit.jobs.job import Outcome, PortablePipeline
from palpate_studies.sweep.combinations import Combination, refuse_hopeless
from palpate_studies.sweep.sweep_table import rows_of

from palpate_notebook.optional_imports import library
from palpate_notebook.pipeline_changes import Draft, load, toml_value
from palpate_notebook.suggestions import with_suggestions

if TYPE_CHECKING:
    import pandas


@with_suggestions
@dataclass(frozen=True)
class Sweep:
    """Results of the runs of a sweep."""

    rows: tuple[Mapping[str, Any], ...]  # one for each track of each combination [SI]
    failures: Mapping[int, str]  # message on each combination that failed, by its number

    @property
    def frame(self) -> pandas.DataFrame:
        """A row for each track of each combination: settings, values [SI], uncertainties, truth, verdict, flags."""
        rows = []
        for row in self.rows:
            codes = [flag["code"] for flag in row.get("flags", ())]
            rows.append({**row, "flags": " ".join(codes)})
        return library("pandas").DataFrame(rows)

    def __len__(self) -> int:
        return len(self.rows)

    def __repr__(self) -> str:
        failed = f", {len(self.failures)} failed" if self.failures else ""
        return f"<Sweep of {len({row['combination'] for row in self.rows})} combinations{failed}; .frame is its table>"


def sweep(
    pipeline: str | Path | Draft,
    settings: Mapping[str, Iterable[object]],
    *,
    combine: Literal["grid", "list"] = "grid",
    folder: str | Path | None = None,
    jobs: int | None = None,
) -> Sweep:
    """Run a pipeline with every combination of settings: ``sweep("point.toml", {"run.seed": range(8)})``.

    `combine` as in ``[sweep]``: every value with every other ("grid"), or the first of each, the second, ... ("list");
    `jobs` is the number of runs at a time, by default one per core. Each run has a folder in the new `folder`; without
    one nothing is kept.

    Raises ConfigurationError for a setting that the pipeline does not have; a combination that fails by itself is in
    `failures`.
    """
    draft = pipeline if isinstance(pipeline, Draft) else load(pipeline)
    values = {key: list(column) for key, column in settings.items()}
    with _sweep_folder(folder) as sweep_folder:
        combinations = []
        for number, assignment in enumerate(_assignments(values, combine), start=1):
            changes = [f"{key}={toml_value(key, value)}" for key, value in assignment.items()]
            job = PortablePipeline(draft.text, draft.path, (*draft.changes, *changes), named=True)
            combinations.append(Combination.of(number, assignment, job, sweep_folder))
        refuse_hopeless(combinations)
        outcomes = _run_outcomes(combinations, jobs)
    rows: list[Mapping[str, Any]] = []
    failures = {}
    for combination in combinations:
        outcome = outcomes[combination.job.name]
        rows += [dict(row) for row in rows_of(combination, outcome)]
        if isinstance(outcome, PalpateError):
            failures[combination.number] = str(outcome)
    return Sweep(tuple(rows), failures)


def _assignments(values: Mapping[str, list[object]], combine: str) -> list[dict[str, object]]:
    """Return the settings of each run: every value with every other ("grid"), or the i-th of each ("list").

    Raises ConfigurationError for lists that are empty, or with "list" of different lengths.
    """
    if not values or not all(values.values()):
        raise ConfigurationError('a sweep needs lists of values by setting, such as {"run.seed": range(8)}')
    lengths = {key: len(column) for key, column in values.items()}
    if combine == "grid":
        return [dict(zip(values, combination, strict=True)) for combination in product(*values.values())]
    if combine != "list":
        raise ConfigurationError(f'combine: {combine!r} is not one of "grid", "list"')
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{key} has {length}" for key, length in lengths.items())
        raise ConfigurationError(f'combine="list" needs lists of one length: {listed}')
    return [dict(zip(values, combination, strict=True)) for combination in zip(*values.values(), strict=True)]


def _run_outcomes(combinations: list[Combination], jobs: int | None) -> dict[str, Outcome]:
    """Return the outcome of each combination by the name of its job; raises KeyboardInterrupt if one is stopped."""
    outcomes = {}
    pending_jobs = [combination.job for combination in combinations]
    with _without_script(), closing(on_all_cores(pending_jobs, jobs)) as finished:
        for job, outcome in finished:
            if isinstance(outcome, StoppedError):
                raise KeyboardInterrupt(str(outcome))
            outcomes[job.name] = outcome
    return outcomes


@contextmanager
def _without_script() -> Iterator[None]:
    """Prevent processes that are started in the context from running the calling script again.

    multiprocessing imports the script by `__file__` or `__spec__` of the main module, which are removed meanwhile.
    """
    attributes = sys.modules["__main__"].__dict__
    removed: dict[str, Any] = {name: attributes.pop(name) for name in ("__file__", "__spec__") if name in attributes}
    attributes["__spec__"] = None
    try:
        yield
    finally:
        attributes.pop("__spec__")
        attributes.update(removed)


@contextmanager
def _sweep_folder(folder: str | Path | None) -> Iterator[Path]:
    """Yield the new folder of the runs, for None a temporary one; raises OutputError for one that exists."""
    if folder is None:
        temporary_folder = Path(tempfile.mkdtemp(prefix="palpate-"))
        try:
            yield temporary_folder
        finally:
            shutil.rmtree(temporary_folder, ignore_errors=True)
        return
    path = Path(folder)
    try:
        path.mkdir(parents=True)
    except FileExistsError as error:
        raise OutputError(f"{path}: exists already, and nothing is ever overwritten") from error
    except OSError as error:
        raise OutputError(f"{path}: cannot be made: {error.strerror}") from error
    yield path
