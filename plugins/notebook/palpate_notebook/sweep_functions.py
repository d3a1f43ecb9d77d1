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
    """What a sweep found."""

    rows: tuple[Mapping[str, Any], ...]  # one for each track of each combination [SI]
    failures: Mapping[int, str]  # why a combination failed, by its number

    @property
    def frame(self) -> pandas.DataFrame:
        """A row for each track of each combination: what was swept, values [SI], uncertainties, truth, verdict."""
        return library("pandas").DataFrame(
            [{**row, "flags": " ".join(flag["code"] for flag in row.get("flags", ()))} for row in self.rows]
        )

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

    `combine` as in ``[sweep]``: every value with every other, or the first of each, the second, ...; `jobs` runs at a
    time, one per core by default. Each run has a folder in the new `folder`; without one nothing of them stays.

    Raises ConfigurationError for a setting that the pipeline does not have; a combination that fails by itself is in
    `failures`.
    """
    draft = pipeline if isinstance(pipeline, Draft) else load(pipeline)
    values = {key: list(column) for key, column in settings.items()}
    combinations = _combinations(values, combine)
    with _place(folder) as place:
        planned = [
            Combination.of(
                number,
                one,
                PortablePipeline(draft.text, draft.path, (*draft.changes, *_changes(one)), named=True),
                place,
            )
            for number, one in enumerate(combinations, start=1)
        ]
        refuse_hopeless(planned)
        found = _run(planned, jobs)
    rows = [dict(row) for one in planned for row in rows_of(one, found[one.job.name])]
    failed = {one.number: found[one.job.name] for one in planned}
    return Sweep(tuple(rows), {number: str(why) for number, why in failed.items() if isinstance(why, PalpateError)})


def _combinations(values: Mapping[str, list[object]], combine: str) -> list[dict[str, object]]:
    if not values or not all(values.values()):
        raise ConfigurationError('a sweep needs lists of values by setting, such as {"run.seed": range(8)}')
    lengths = {key: len(column) for key, column in values.items()}
    if combine == "grid":
        return [dict(zip(values, one, strict=True)) for one in product(*values.values())]
    if combine != "list":
        raise ConfigurationError(f'combine: {combine!r} is not one of "grid", "list"')
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{key} has {length}" for key, length in lengths.items())
        raise ConfigurationError(f'combine="list" needs lists of one length: {listed}')
    return [dict(zip(values, one, strict=True)) for one in zip(*values.values(), strict=True)]


def _changes(values: Mapping[str, object]) -> list[str]:
    return [f"{key}={toml_value(key, value)}" for key, value in values.items()]


def _run(planned: list[Combination], jobs: int | None) -> dict[str, Outcome]:
    found = {}
    with _without_script(), closing(on_all_cores([one.job for one in planned], jobs)) as running:
        for job, outcome in running:
            if isinstance(outcome, StoppedError):
                raise KeyboardInterrupt(str(outcome))
            found[job.name] = outcome
    return found


@contextmanager
def _without_script() -> Iterator[None]:
    """Processes started in the context do not run the calling script again."""
    main = sys.modules["__main__"]
    kept: dict[str, Any] = {name: main.__dict__.pop(name) for name in ("__file__", "__spec__") if name in main.__dict__}
    main.__dict__["__spec__"] = None
    try:
        yield
    finally:
        main.__dict__.pop("__spec__")
        main.__dict__.update(kept)


@contextmanager
def _place(folder: str | Path | None) -> Iterator[Path]:
    """The folder of the runs: a new one that stays, or one that does not."""
    if folder is None:
        made = Path(tempfile.mkdtemp(prefix="palpate-"))
        try:
            yield made
        finally:
            shutil.rmtree(made, ignore_errors=True)
        return
    place = Path(folder)
    try:
        place.mkdir(parents=True)
    except FileExistsError as error:
        raise OutputError(f"{place}: exists already, and nothing is ever overwritten") from error
    except OSError as error:
        raise OutputError(f"{place}: cannot be made: {error.strerror}") from error
    yield place
