"""What is asked of a fit: the options of ``palpate fit``, ``palpate fit compare`` and ``palpate fit cycles``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import typer
from palpate import ConfigurationError
from palpate_kit.curves.fit_folder import is_fit_folder

FilesArgument = Annotated[
    list[Path],
    typer.Argument(metavar="SOURCE...", help="Files or folders, with --tip; pipelines; logs that --pipeline can read."),
]
SourcesArgument = Annotated[
    list[Path], typer.Argument(metavar="SOURCE...", help="Pipeline files, or logs that --pipeline can read.")
]
PipelineOption = Annotated[
    Path | None, typer.Option(help="How to read the logs: a pipeline with one device that has a file.")
]
TipOption = Annotated[
    str | None, typer.Option(help='Fit files without a pipeline, or folders of them: "sphere 3 mm" (its radius).')
]
ModelOption = Annotated[
    str | None, typer.Option(help="With --tip: the contact model, by name or initials. [default: dr]")
]
CurveOption = Annotated[
    str | None,
    typer.Option("--curve", metavar="NAME", help="With --tip: one curve of a map or a workbook, by its name."),
]
OutOption = Annotated[
    Path | None,
    typer.Option(
        "--out", "-o", help="Folder; what is fitted already in one of the same logs is kept. [default: runs/...]"
    ),
]
PicturesOption = Annotated[bool, typer.Option(help="Draw force over time and depth, and residuals.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print fit.json instead of the tables.")]
EachOption = Annotated[
    bool, typer.Option("--each", help="Thousands of curves, one a file: a row of fits.csv each; --out goes on.")
]
ByOption = Annotated[
    str | None,
    typer.Option(
        help='With --tip: groups by a pattern of the names, as in "(ctrl|treat)", or a column of curves.csv. With '
        "--each: a new curve begins where this channel changes."
    ),
]
JobsOption = Annotated[int | None, typer.Option(help="With --each: curves at a time. [default: one per core]", min=1)]
UnsetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--unset",
        metavar="TABLE.KEY",
        help="Take back a setting of these curves; without --where a fact.",
    ),
]
GroupsOption = Annotated[
    Path | None, typer.Option(help="Of a folder of fits: a CSV with a column `curve`, and columns to group by.")
]
NoRefitOption = Annotated[
    bool, typer.Option("--no-refit", help="Of many curves: write the settings, and fit nothing yet.")
]


@dataclass(frozen=True)
class FitRequest:
    """Sources and options as they were typed."""

    sources: tuple[Path, ...]
    pipeline: Path | None = None  # that reads the sources
    overrides: tuple[str, ...] = ()
    tip: str | None = None
    model: str | None = None
    choices: Mapping[str, str] = field(default_factory=dict)  # columns by role, and the rate
    out: Path | None = None
    scheduler: str | None = None
    stage: str | None = None
    pictures: bool = True
    as_json: bool = False
    details: bool = False
    each: bool = False
    by: str | None = None
    jobs: int | None = None
    where: str | None = None
    unset: tuple[str, ...] = ()
    groups: Path | None = None
    fitting: bool = True
    curve: str | None = None  # the one of a file of several that is to be fitted

    @property
    def fit_folder(self) -> Path | None:
        """The folder of fits that is to be fitted again; None for any other sources."""
        return self.sources[0] if len(self.sources) == 1 and is_fit_folder(self.sources[0]) else None

    @property
    def has_pipeline(self) -> bool:
        """Return True where a pipeline is named."""
        return self.pipeline is not None or any(source.suffix == ".toml" for source in self.sources)

    def demand_no_folder_options(self) -> None:
        """Raise ConfigurationError for options that only a folder of fits takes."""
        for option, value in (("--where", self.where), ("--unset", self.unset), ("--groups", self.groups)):
            if value:
                raise ConfigurationError(f"{option}: is for one folder of fits, that --each or --tip has made")
