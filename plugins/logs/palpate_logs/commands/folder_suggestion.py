"""One pipeline for a folder of logs that are read alike, and the names of those that are not."""

from __future__ import annotations

from pathlib import Path

import typer
from palpate import LogError, OutputError, printable
from palpate_engine import registry
from palpate_kit.curves.alike_logs import AlikeLogs, alike_logs, differences, logs_among
from palpate_kit.logs.draft_pipeline import pipeline_of, rate_note, reader_of, suggestion_of
from palpate_kit.terminal.json_output import print_json
from palpate_kit.terminal.progress import progress

_NAMED, _KEYS = 4, 3  # files of a group, and keys in which it differs, that are named


def is_folder_of_logs(path: Path) -> bool:
    """Whether a path is a folder that is not a log by itself, as a bag is."""
    return path.is_dir() and reader_of(path, registry.load()) is None


def suggest_folder(folder: Path, choices: dict[str, str], out: Path | None, as_json: bool) -> None:
    """Print or write the pipeline of the most files, and one more for each other group; raises LogError."""
    known = registry.load()
    refused: dict[str, str] = {}
    with progress(f"look at {folder.name}"):
        groups = alike_logs(logs_among([folder], known), lambda log: suggestion_of(log, choices, known), refused)
    if note := rate_note(choices, (group.suggestion for group in groups for _ in group.logs)):
        typer.echo(note, err=True)
    if not groups:
        name, reason = next(iter(refused.items()))
        raise LogError(f"{name}: {reason}")
    paths = [_path(out, number) for number in range(1, len(groups) + 1)]
    texts = [
        pipeline_of(group.suggestion, group.logs[0], None if path is None else path.parent)
        for group, path in zip(groups, paths, strict=True)
    ]
    _write(paths, texts)
    if as_json:
        files = [[str(log) for log in group.logs] for group in groups]
        print_json({"pipelines": texts, "files": files, "refused": refused})
    elif out is None:
        typer.echo(texts[0], nl=False)
    for number, (group, path) in enumerate(zip(groups, paths, strict=True)):
        typer.echo(_words(group, groups[0] if number else None, path), err=True)
    for name, reason in refused.items():
        typer.echo(f"{name}: {printable(reason)}", err=True)
    if out is not None:
        typer.echo(f"fit the files of one: palpate fit FILES --each --pipeline {out}", err=True)


def _path(out: Path | None, number: int) -> Path | None:
    return out if out is None or number == 1 else out.with_name(f"{out.stem}-{number}{out.suffix}")


def _write(paths: list[Path | None], texts: list[str]) -> None:
    """Write every pipeline, or none where one exists; raises OutputError."""
    for path in paths:
        if path is not None and path.exists():
            raise OutputError(f"{path}: exists already, and nothing is ever overwritten")
    for path, text in zip(paths, texts, strict=True):
        if path is None:
            continue
        try:
            with path.open("x", encoding="utf-8") as file:
                file.write(text)
        except OSError as error:
            raise OutputError(f"{path}: cannot write: {error.strerror}") from error


def _words(group: AlikeLogs[Path], usual: AlikeLogs[Path] | None, path: Path | None) -> str:
    """How many files are read alike, in what they differ from the usual ones, and what is to be checked of them."""
    names = ", ".join(printable(log.name) for log in group.logs[:_NAMED])
    names += f" and {len(group.logs) - _NAMED} more" if len(group.logs) > _NAMED else ""
    count = f"{len(group.logs)} file{'s' if len(group.logs) > 1 else ''}"
    where = "" if path is None else f"{path}: "
    if usual is None:
        told = f"{where}{count} read alike: {names}"
    else:
        keys = differences(usual.suggestion, group.suggestion)
        more = ", ..." if len(keys) > _KEYS else ""
        told = f"{where}{count} with another {', '.join(keys[:_KEYS])}{more}: {names}"
    said = [f"  fill in: {printable(text)}" for text in group.suggestion.blanks]
    said += [f"  check: {printable(text)}" for text in group.suggestion.doubts]
    return "\n".join([told, *said])
