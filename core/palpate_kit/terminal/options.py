"""Options that several commands share, so that each means the same everywhere."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate_kit.terminal.layout import Layout, choose

Overrides = Annotated[
    list[str] | None, typer.Option("--set", metavar="TABLE.KEY=VALUE", help="Override a setting; can be repeated.")
]
Points = Annotated[
    Path | None,
    typer.Option(
        help="Point palpations on the same line, to compare the sweep with: a run, or a pipeline file to run."
    ),
]
TrackOption = Annotated[str | None, typer.Option(help="Track, as model/estimator. [default: the best]")]
FolderOption = Annotated[
    Path | None,
    typer.Option("--out", "-o", help="Folder to write to; must be new or empty. [default: runs/DATE_TIME_NAME]"),
]
FormatOption = Annotated[
    Layout,
    typer.Option("--format", callback=choose, help="Print the tables as they are, as CSV, or as LaTeX (booktabs)."),
]
DetailsOption = Annotated[bool, typer.Option("--details", help="Print everything that was found.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON in place of the table.")]
WhereOption = Annotated[
    str | None,
    typer.Option(
        "--where", metavar="WORDS",
        help="Of a folder of fits of many curves only these, such as 'verdict:doubtful sample=S1 E>100 rms<0.05'.",
    ),
]  # fmt: skip
UnitOption = Annotated[
    str | None,
    typer.Option(
        metavar="COLUMN",
        help="What is compared: means of units by a column of curves.csv, such as animal, or curve. [default: the "
        "column with at least two values in each group, each value in one group]",
    ),
]
UnchangedOption = Annotated[bool, typer.Option("--yes", help="Ask nothing: specimen and tool are still the same.")]
ForceOption = Annotated[str | None, typer.Option(help="With --tip: the column of the force.")]
PositionOption = Annotated[str | None, typer.Option(help="With --tip: the column of the height or depth.")]
TimeOption = Annotated[str | None, typer.Option(help="With --tip: the column of the time.")]
LateralOption = Annotated[
    str | None,
    typer.Option(metavar="COLUMN[,COLUMN]", help="With --tip: the place along the skin, or its x and y."),
]
RateOption = Annotated[str | None, typer.Option(help='With --tip: of readings without a time, as in "500 Hz".')]
