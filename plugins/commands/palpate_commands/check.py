"""``palpate check``: every mistake in a pipeline, without running it."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer
from palpate_engine import load_pipeline, resolved_text, single_trajectory, start_tracks
from palpate_kit.terminal.json_output import print_json
from palpate_kit.terminal.options import JsonOption, Overrides


def check(
    file: Annotated[Path, typer.Argument(help="The pipeline file.")],
    overrides: Overrides = None,
    resolved: Annotated[bool, typer.Option("--resolved", help="Print the pipeline with every default, in SI.")] = False,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Print every plugin and where it is.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Check a pipeline without running it: every mistake at once, each with its line."""
    pipeline = load_pipeline(file, overrides or [])
    if len(pipeline.trajectories) > 1 and not any(device.duration is not None for device in pipeline.devices.values()):
        single_trajectory(pipeline)
    names = [running.track.name for running in start_tracks(pipeline)]
    tracks = ", ".join(names)
    if as_json:
        plugins = [{"name": plugin.name, "place": plugin.place} for plugin in pipeline.registry.plugins]
        shared = {"inherited": dict(pipeline.inherited)} if pipeline.inherited else {}
        facts = {**shared, "file": file, "devices": list(pipeline.devices), "tracks": names, "plugins": plugins}
        print_json({**facts, "notices": pipeline.notices, "resolved": tomllib.loads(resolved_text(pipeline))})
    elif resolved:
        typer.echo(resolved_text(pipeline), nl=False)
    else:
        devices = ", ".join(pipeline.devices)
        for notice in pipeline.notices:
            typer.echo(notice, err=True)
        for place, keys in _keys_by_file(pipeline.inherited).items():
            typer.echo(f"{place}: {', '.join(keys)}")
        typer.echo(f"{file} is in order: devices {devices}; tracks {tracks}")
        for plugin in pipeline.registry.plugins if verbose else ():
            typer.echo(f"plugin {plugin.name}" + (f" from {plugin.place}" if plugin.place != plugin.name else ""))
        third_parties = [plugin.name for plugin in pipeline.registry.plugins if not plugin.name.startswith("palpate ")]
        if third_parties and not verbose:
            typer.echo(f"with {', '.join(third_parties)}; -v says where every plugin is")


def _keys_by_file(inherited: Mapping[str, str]) -> dict[str, list[str]]:
    """Return the keys that each base states, in the order of the keys."""
    keys: dict[str, list[str]] = {}
    for key, place in sorted(inherited.items()):
        keys.setdefault(place.rpartition(":")[0], []).append(key)
    return keys
