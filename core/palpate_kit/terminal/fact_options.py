"""The facts of a rig as options of a command, one for each key of ``rig.toml``."""

from __future__ import annotations

import functools
import inspect
import json
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer
from palpate_engine import NO_SETTINGS, RigFacts, option_of

_PANEL = "Facts of rig and specimen"


def with_facts(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command with an option for each fact, and --rig for a file of facts; both become `overrides`."""
    signature = inspect.signature(command, eval_str=True)
    names = [
        name
        for name in RigFacts.model_fields
        if name not in (*NO_SETTINGS, *signature.parameters) or name == "position"
    ]
    # The parameters by which typer shows the options; a fact whose option the command itself has gets none.
    parameters = {f"fact_{name}": _option(name) for name in names}
    rig = Annotated[
        Path | None,
        typer.Option("--rig", help="File of facts. [default: rig.toml next to the curves]", rich_help_panel=_PANEL),
    ]
    parameters["rig"] = inspect.Parameter("rig", inspect.Parameter.KEYWORD_ONLY, default=None, annotation=rig)

    @functools.wraps(command)
    def with_options(*arguments: Any, **options: Any) -> None:
        """Call the command with the facts as assignments among its overrides."""
        options_of_facts = {name: options.pop(f"fact_{name}", None) for name in names}
        stated = [f"rig.{name}={json.dumps(text)}" for name, text in options_of_facts.items() if text is not None]
        rig = options.pop("rig", None)
        stated += [f"run.rig={json.dumps(str(rig.absolute()))}"] if rig is not None else []
        if stated:
            bound = signature.bind_partial(*arguments, **options)
            bound.arguments["overrides"] = [*(bound.arguments.get("overrides") or ()), *stated]
            arguments, options = bound.args, bound.kwargs
        command(*arguments, **options)

    all_parameters = [*signature.parameters.values(), *parameters.values()]
    with_options.__signature__ = signature.replace(parameters=all_parameters)  # type: ignore[attr-defined]
    with_options.__annotations__ = {parameter.name: parameter.annotation for parameter in all_parameters}
    return with_options


def _option(name: str) -> inspect.Parameter:
    """Return the option of a fact, with the description of its key as help."""
    description = RigFacts.model_fields[name].description or ""
    option = typer.Option(
        option_of(name), metavar="TEXT", help=f"{description[:1].upper()}{description[1:]}.", rich_help_panel=_PANEL
    )
    keyword_only = inspect.Parameter.KEYWORD_ONLY
    return inspect.Parameter(f"fact_{name}", keyword_only, default=None, annotation=Annotated[str | None, option])
