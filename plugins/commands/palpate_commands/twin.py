"""``palpate twin``: the rig of a pipeline in software, for its real drivers."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer
from palpate import ConfigurationError
from palpate_engine import load_pipeline
from palpate_kit.terminal.options import Overrides


def twin(
    file: Annotated[Path, typer.Argument(help="The pipeline file, with a [twin.*] table.")],
    overrides: Overrides = None,
    seed: Annotated[int, typer.Option(help="Seed of the twin's noise.", min=0)] = 0,
) -> None:
    """Serve the twin of a pipeline's rig until Ctrl-C or the end of the input; type `help` for faults to try."""
    pipeline = load_pipeline(file, overrides or [])
    if len(pipeline.twins) != 1:
        raise ConfigurationError(f"{file}: expected one [twin.*] table, not {len(pipeline.twins)}")

    def ready(facts: Mapping[str, str]) -> None:
        typer.echo("ready: " + ", ".join(f"{name} {value}" for name, value in facts.items()))

    next(iter(pipeline.twins.values())).serve(seed, ready)
