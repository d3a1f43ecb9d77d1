"""The screen of a folder of fits: rows with their verdicts, findings, open facts, and how many have which."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence

from palpate_engine import registry
from palpate_kit.curves.curve_pipelines import dialect_pipeline
from palpate_kit.curves.fit_folder import FitFolder
from palpate_kit.curves.shared_specimen import SetupPair
from palpate_kit.terminal.layout import print_line
from palpate_kit.terminal.result_screen import title_line
from palpate_kit.terminal.result_table import counted

from palpate_fits.fact_report import list_advice
from palpate_fits.file_tables import partition_line, show_rows
from palpate_fits.setup_tables import show_pairs


def show_folder(folder: FitFolder, pairs: Sequence[SetupPair], refused: Mapping[str, str], details: bool) -> None:
    """Print the rows of a folder of fits in the order of its curves; `refused` says why files were not read."""
    places = {name: place for place, name in enumerate(folder.names)}
    rows = sorted(folder.cells, key=lambda row: places[row["curve"]])
    rows += [{"curve": name, "error": error} for name, error in refused.items()]
    command = shlex.join(["palpate", "fit", str(folder.path)])
    pipeline, parts = dialect_pipeline(folder), registry.load()
    print_line(title_line(counted(len(folder.names), "file")))
    show_rows(rows, pipeline, parts, command, details, list_advice(folder.path))
    show_pairs(pairs)
    print_line(partition_line(rows, pipeline, parts))
