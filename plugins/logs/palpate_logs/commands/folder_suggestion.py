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

# Choices: what fits into a line.
_MAX_FILES = 4  # of a group that are named
_MAX_KEYS = 3  # in which a group differs that are named


def is_folder_of_logs(path: Path) -> bool:
    """Return True for a folder that is not a log by itself, as a bag is."""
    return path.is_dir() and reader_of(path, registry.load()) is None


def suggest_folder(folder: Path, choices: dict[str, str], out: Path | None, as_json: bool) -> None:
    """Print or write the pipeline of the largest group of files read alike, and one for each other group.

    Raises LogError if no file can be read, OutputError.
    """
    plugins = registry.load()
    refused: dict[str, str] = {}  # by file: the reason
    with progress(f"look at {folder.name}"):
        groups = alike_logs(logs_among([folder], plugins), lambda log: suggestion_of(log, choices, plugins), refused)
    note = rate_note(choices, (group.suggestion for group in groups for _ in group.logs))
    if note:
        typer.echo(note, err=True)
    if not groups:
        name, reason = next(iter(refused.items()))
        raise LogError(f"{name}: {reason}")
    # Each group has a pipeline, by the suggestion for its first log; paths are relative to the file, if there is one.
    paths: list[Path | None] = []
    texts: list[str] = []
    for number, group in enumerate(groups, start=1):
        path = None if out is None else _numbered_path(out, number)
        paths.append(path)
        texts.append(pipeline_of(group.suggestion, group.logs[0], None if path is None else path.parent))
    _write_pipelines(paths, texts)
    # The pipelines go to standard output, all else to standard error.
    if as_json:
        files = [[str(log) for log in group.logs] for group in groups]
        print_json({"pipelines": texts, "files": files, "refused": refused})
    elif out is None:
        typer.echo(texts[0], nl=False)
    _print_groups(groups, paths, refused)
    if out is not None:
        typer.echo(f"fit the files of one: palpate fit FILES --each --pipeline {out}", err=True)


def _print_groups(groups: list[AlikeLogs[Path]], paths: list[Path | None], refused: dict[str, str]) -> None:
    """Print a report of each group, the largest first, and the reason for each file that cannot be read."""
    for group, path in zip(groups, paths, strict=True):
        largest_group = None if group is groups[0] else groups[0]
        typer.echo(_group_report(group, largest_group, path), err=True)
    for name, reason in refused.items():
        typer.echo(f"{name}: {printable(reason)}", err=True)


def _numbered_path(out: Path, number: int) -> Path:
    """Return the path of a pipeline by its number from 1: out.toml, out-2.toml, out-3.toml, ..."""
    return out if number == 1 else out.with_name(f"{out.stem}-{number}{out.suffix}")


def _write_pipelines(paths: list[Path | None], texts: list[str]) -> None:
    """Write the text of each pipeline that has a path; raises OutputError, before any is written if a file exists."""
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


def _group_report(group: AlikeLogs[Path], largest_group: AlikeLogs[Path] | None, path: Path | None) -> str:
    """Return lines on a group of files: how many are read alike, and what a person must fill in and check.

    `path` is that of their pipeline. Of any but the largest group the first line names the keys in which it differs.
    """
    names = ", ".join(printable(log.name) for log in group.logs[:_MAX_FILES])
    if len(group.logs) > _MAX_FILES:
        names += f" and {len(group.logs) - _MAX_FILES} more"
    count = f"{len(group.logs)} file{'s' if len(group.logs) > 1 else ''}"
    likeness = "read alike"
    if largest_group is not None:
        keys = differences(largest_group.suggestion, group.suggestion)
        more = ", ..." if len(keys) > _MAX_KEYS else ""
        likeness = f"with another {', '.join(keys[:_MAX_KEYS])}{more}"
    prefix = "" if path is None else f"{path}: "
    lines = [f"{prefix}{count} {likeness}: {names}"]
    lines += [f"  fill in: {printable(text)}" for text in group.suggestion.blanks]
    lines += [f"  check: {printable(text)}" for text in group.suggestion.doubts]
    return "\n".join(lines)
