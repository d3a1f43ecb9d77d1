"""``palpate check``: every mistake in a pipeline, without running it."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from palpate_engine import Pipeline, load_pipeline, resolved_text, single_trajectory, start_tracks
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
    # Several trajectories are refused, unless a device, such as a log, says when the run ends.
    has_own_end = any(device.duration is not None for device in pipeline.devices.values())
    if len(pipeline.trajectories) > 1 and not has_own_end:
        single_trajectory(pipeline)
    track_names = [running.track.name for running in start_tracks(pipeline)]
    if as_json:
        print_json(_check_table(file, pipeline, track_names))
    elif resolved:
        typer.echo(resolved_text(pipeline), nl=False)
    else:
        _print_check(file, pipeline, track_names, verbose)


def _check_table(file: Path, pipeline: Pipeline, track_names: Sequence[str]) -> dict[str, Any]:
    """Return a pipeline in order as plain data."""
    plugins = [{"name": plugin.name, "place": plugin.place} for plugin in pipeline.registry.plugins]
    table: dict[str, Any] = {"inherited": dict(pipeline.inherited)} if pipeline.inherited else {}
    table |= {"file": file, "devices": list(pipeline.devices), "tracks": track_names, "plugins": plugins}
    return table | {"notices": pipeline.notices, "resolved": tomllib.loads(resolved_text(pipeline))}


def _print_check(file: Path, pipeline: Pipeline, track_names: Sequence[str], verbose: bool) -> None:
    """Print notices, the keys of each base, devices and tracks, and the plugins: third parties, or all of them."""
    for notice in pipeline.notices:
        typer.echo(notice, err=True)
    for place, keys in _keys_by_file(pipeline.inherited).items():
        typer.echo(f"{place}: {', '.join(keys)}")
    devices, tracks = ", ".join(pipeline.devices), ", ".join(track_names)
    typer.echo(f"{file} is in order: devices {devices}; tracks {tracks}")
    plugins = pipeline.registry.plugins
    if verbose:
        for plugin in plugins:
            typer.echo(f"plugin {plugin.name}" + (f" from {plugin.place}" if plugin.place != plugin.name else ""))
        return
    third_parties = [plugin.name for plugin in plugins if not plugin.name.startswith("palpate ")]
    if third_parties:
        typer.echo(f"with {', '.join(third_parties)}; -v says where every plugin is")


def _keys_by_file(inherited: Mapping[str, str]) -> dict[str, list[str]]:
    """Return the keys that each base states, in the order of the keys."""
    keys: dict[str, list[str]] = {}
    for key, place in sorted(inherited.items()):
        keys.setdefault(place.rpartition(":")[0], []).append(key)
    return keys
