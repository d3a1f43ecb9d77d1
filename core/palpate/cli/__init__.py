"""The command line: what each ``palpate`` command is, and what its exit code says."""

from __future__ import annotations

import importlib.metadata
import sys
import traceback
from typing import Annotated

import typer

from palpate.cli import (
    calibrate,
    compare,
    design,
    doctor,
    export,
    force,
    inspect,
    log_info,
    lumps,
    plan,
    recover,
    repeat,
    resume,
    run,
    search,
    sweep,
    twin,
)
from palpate.cli import map as maps
from palpate.cli.fit import fit
from palpate.errors import PalpateError

app = typer.Typer(
    name="palpate",
    help="Elasticity and viscosity of soft material from robotic palpation, each with its uncertainty.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",  # rich's own markup would take [tables] for tags
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"palpate {importlib.metadata.version('palpate')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Shared options."""


app.command(name="run")(run.run)
app.command(name="sweep")(sweep.sweep)
app.command(name="fit")(fit)
app.command(name="repeat")(repeat.repeat)
app.command(name="calibrate")(calibrate.calibrate)
app.command(name="design")(design.design)
app.command(name="check")(inspect.check)
app.command(name="plan")(plan.plan)
app.command(name="resume")(resume.resume)
app.command(name="map")(maps.map_run)
app.command(name="lumps")(lumps.lumps)
app.command(name="compare-sites")(lumps.compare)
app.command(name="search")(search.search)
app.command(name="list")(inspect.list_parts)
app.command(name="describe")(inspect.describe)
app.command(name="schema")(inspect.schema)
app.command(name="force")(force.force)
app.command(name="info")(log_info.info)
app.command(name="compare")(compare.compare)
app.command(name="export")(export.export)
app.command(name="recover")(recover.recover)
app.command(name="doctor")(doctor.doctor)
app.command(name="twin")(twin.twin)


def main() -> None:
    """The ``palpate`` command: exit code 0, 2 for what the user can mend, 1 for what they cannot, 130 for Ctrl-C."""
    try:
        app()
    except PalpateError as error:
        typer.echo(f"palpate: {error}", err=True)
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        typer.echo("palpate: stopped", err=True)
        sys.exit(130)
    except BrokenPipeError:  # the reader of a pipe, such as head, has gone
        sys.stderr.close()
        sys.exit(1)
    except Exception:
        traceback.print_exc()
        typer.echo("palpate: this is a bug in palpate or in a plugin of yours, not in your pipeline", err=True)
        sys.exit(1)
