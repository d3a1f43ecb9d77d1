"""``palpate init``: a pipeline, or a distribution with a part of one's own, to start from."""

from __future__ import annotations

import re
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Annotated

import typer
from palpate import ConfigurationError, OutputError, Template, suggest
from palpate_engine import registry, write_new

from palpate_commands.distribution import KINDS, distribution

_PACKAGE = "palpate_commands"
_VERSION = 'palpate = "0.2"                        # the version for which this is written'
_NEXT_COMMANDS = {
    "ur3e": "palpate rehearse {0}   # in simulated time; nothing real moves",
    "raster-ur3e": "palpate rehearse {0} --out rehearsal\npalpate map rehearsal",
    "breast-ur3e": "palpate check motion {0}   # docs/tutorials/breast.md goes on from here",
    "raster": "palpate run {0} --out raster\npalpate map raster",
    "calibrate": "palpate calibrate {0} --yes",
}
_DEVICE = re.compile(r"^\[device\.", re.MULTILINE)
_EXAMPLE_FILES = {"log": ("log.csv",), "breast-ur3e": ("breast.obj",)}


def init(
    what: Annotated[
        str | None,
        typer.Argument(
            metavar="[WHAT]",
            help="point, chirp, log, ur3e, raster, raster-ur3e, breast-ur3e or calibrate; with --plugin its name. "
            "[default: asks]",
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="File, or folder of a plugin. [default: named after it]")
    ] = None,
    plugin: Annotated[
        str | None, typer.Option(metavar="KIND", help="A distribution with one: tip, model, filter, device, arm, ...")
    ] = None,
) -> None:
    """Write a commented pipeline that runs as it is; with --plugin a distribution of your own, with its test.

    Kinds of plugins: tip, model, filter, device, arm, trajectory, analysis.
    """
    if plugin is None:
        _write_pipeline(what, out)
    elif what is None:
        raise ConfigurationError(f"--plugin {plugin}: its name is missing: palpate init --plugin {plugin} NAME")
    else:
        _write_plugin(plugin, what, out)


def _write_pipeline(name: str | None, out: Path | None) -> None:
    """Write the template of a name, with its example files; raises OutputError where one exists."""
    offers = registry.offers("palpate_templates", Template)
    texts = {name: offer.text() for name, offer in offers.items()}
    pipelines = {name: text for name, text in texts.items() if _DEVICE.search(text)}  # others are parts of one
    name = name or _ask({name: offers[name].help for name in pipelines})
    if name not in pipelines:
        raise ConfigurationError(f"no pipeline {name!r} to start from{suggest(name, pipelines)}")
    file = out or Path(f"{name}.toml")
    text = _user_text(pipelines[name], Path(offers[name].path).name, str(file))
    examples = {example: file.parent / example for example in _EXAMPLE_FILES.get(name, ())}
    for path in (file, *examples.values()):
        if path.exists():
            raise OutputError(f"{path}: exists already, and nothing is ever overwritten; give another one with -o FILE")
    file.parent.mkdir(parents=True, exist_ok=True)
    write_new(file, text)
    for example, path in examples.items():
        write_new(path, files(_PACKAGE).joinpath("templates", example).read_text(encoding="utf-8"))
    paths = ", ".join(str(path) for path in (file, *examples.values()))
    typer.echo(f"written: {paths}; now:\n{_NEXT_COMMANDS.get(name, 'palpate run {0}').format(file)}")


def _ask(texts: Mapping[str, str]) -> str:
    """Return the name of the template that a person chooses; raises ConfigurationError without an answer."""
    for name, text in texts.items():
        typer.echo(f"  {name:<12} {text}", err=True)
    try:
        return str(typer.prompt("which", err=True)).strip()
    except (EOFError, typer.Abort) as error:
        raise ConfigurationError(f"no answer; palpate init NAME writes one of {', '.join(texts)}") from error


def _user_text(text: str, name: str, file: str) -> str:
    """Return a pipeline of the repository as a user's: with the name of its file, and the version that it is for."""
    lines = [line for line in text.splitlines() if not line.startswith("#:schema")]
    lines = [line.replace(f"pipelines/{name}", file) for line in lines]
    head = next(i for i, line in enumerate(lines) if not line.startswith("#"))
    return "\n".join([*lines[:head], "", _VERSION, *lines[head:]]) + "\n"


def _write_plugin(kind: str, name: str, out: Path | None) -> None:
    """Write a distribution with a part of a kind; raises ConfigurationError for an unknown kind or an invalid name."""
    if kind not in KINDS:
        raise ConfigurationError(f"--plugin: no kind {kind!r}{suggest(kind, KINDS)}")
    if not re.fullmatch(r"[a-z][a-z0-9]*(-[a-z0-9]+)*", name):
        raise ConfigurationError(
            f"{name!r}: a plugin's name is of small letters, digits and hyphens, such as palpate-funnel"
        )
    folder = out or Path(name)
    if folder.exists():
        raise OutputError(f"{folder}: exists already, and nothing is ever overwritten; give another one with -o FOLDER")
    for path, text in distribution(kind, name).items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        write_new(folder / path, text)
    typer.echo(f"written: {folder}; now:\npip install -e {folder} pytest\npytest {folder}\npalpate list")
