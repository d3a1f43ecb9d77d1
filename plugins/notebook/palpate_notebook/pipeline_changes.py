"""A pipeline file with changed settings, to be run."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tomli_w
from palpate import ConfigurationError
from palpate_engine import Pipeline, Source, build_pipeline

from palpate_notebook.suggestions import with_suggestions

if TYPE_CHECKING:
    from palpate_notebook.run_object import FinishedRun


@with_suggestions
@dataclass(frozen=True)
class Draft:
    """Pipeline file with changed settings; every change makes a new draft."""

    path: Path
    text: str
    changes: tuple[str, ...] = ()  # "table.key=value", as of `--set`

    def set(self, key: str, value: object) -> Draft:
        """Return a draft with one setting changed: ``set("estimator.ekf.force_std", "0.03 N")``.

        Raises ConfigurationError for a value that no pipeline file can hold; keys are judged with everything else.
        """
        return replace(self, changes=(*self.changes, f"{key}={toml_value(key, value)}"))

    @property
    def source(self) -> Source:
        """The text of the file with the changes; raises ConfigurationError."""
        source = Source(self.text, self.path, named=True)
        for change in self.changes:
            source.override(change)
        return source

    def check(self) -> Pipeline:
        """Return the pipeline, checked; raises ConfigurationError with every mistake at once."""
        return build_pipeline(self.source)

    def run(self, folder: str | Path | None = None, *, seed: int | None = None) -> FinishedRun:
        """Run the pipeline into a `folder`; without one nothing is kept, except the run of a live robot, in runs/.

        Raises ConfigurationError with every mistake of the file, DeviceError where a device fails, StoppedError where
        the user stops it.
        """
        from palpate_notebook.run_data import execute
        from palpate_notebook.run_object import FinishedRun

        draft = self if seed is None else self.set("run.seed", seed)
        return execute(FinishedRun, draft.check(), Path(folder) if folder is not None else None)

    def __repr__(self) -> str:
        changes = "".join(f"\n  {change}" for change in self.changes)
        return f"<Draft of {self.path}{changes}>"


def toml_value(key: str, value: object) -> str:
    """Return a value in TOML; raises ConfigurationError for one that TOML cannot write.

    Arrays, ranges and tuples become lists, quantities plain numbers, and paths texts.
    """
    plain: Any = value
    if hasattr(plain, "tolist"):
        plain = plain.tolist()
    elif isinstance(value, range | tuple):
        plain = list(value)
    elif isinstance(value, float):
        plain = float(value)  # a quantity would be printed with its unit
    if isinstance(plain, Path):
        plain = str(plain)
    if isinstance(plain, dict):
        raise ConfigurationError(f"{key}: is a table: set its keys one by one, as in {key}.KEY")
    try:
        return tomli_w.dumps({"v": plain}).strip().removeprefix("v = ")
    except TypeError as error:
        raise ConfigurationError(f"{key}: {value!r} cannot be written in a pipeline file") from error


def load(path: str | Path) -> Draft:
    """Return a pipeline file, to be changed and run; raises ConfigurationError for one that is not readable TOML."""
    source = Source.read(Path(path))
    return Draft(source.path, source.text)


def run(path: str | Path, folder: str | Path | None = None, *, seed: int | None = None) -> FinishedRun:
    """Run a pipeline file; see `Draft.run`."""
    return load(path).run(folder, seed=seed)
