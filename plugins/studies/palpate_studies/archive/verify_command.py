"""``palpate verify``: the study of an archive made again from its curves, and compared."""

from __future__ import annotations

import math
import shlex
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer
from palpate import ConfigurationError, LogError, OutputError, printable
from palpate_engine import (
    ConsentError,
    Enclosure,
    Source,
    analysis,
    build_pipeline,
    library_versions,
    plugin_files,
    write_whole,
)
from palpate_kit.curves.curve_fits import offline
from palpate_kit.curves.curve_pipelines import dialect_pipeline
from palpate_kit.curves.curve_table import TABLE, columns_of_fits, fitted_rows, write_rows
from palpate_kit.curves.fit_folder import FitFolder
from palpate_kit.curves.fit_provenance import PROVENANCE
from palpate_kit.curves.folder_settings import SETTINGS
from palpate_kit.terminal.json_output import print_aside, print_json
from palpate_kit.terminal.options import JsonOption

from palpate_studies.archive.archive_file import FITS, Manifest, digest_of, files_below, unpack
from palpate_studies.archive.row_differences import RowDifference, row_differences
from palpate_studies.archive.study_pages import write_pages

_SHOWN = 20  # differences on a screen


@dataclass(frozen=True)
class Verification:
    """What was found when a study was made again."""

    curves: int
    packed_with: str  # version of palpate
    this: str
    other_versions: dict[str, tuple[str, str]]  # of what numbers depend on, by name: packed with, and here
    same_files: list[str]
    other_files: list[str]
    differences: list[RowDifference]

    @property
    def passed(self) -> bool:
        """Whether all is the same to the byte; by another version of palpate, whether every number is."""
        return not self.differences and (not self.other_files or self.packed_with != self.this)


def verify(
    archive: Annotated[Path, typer.Argument(metavar="STUDY.zip", help="What palpate pack has written.")],
    curves: Annotated[
        Path | None, typer.Option(help="Folder with the curves of an archive that holds their hashes only.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Keep what is made in this folder; must be new or empty.")
    ] = None,
    jobs: Annotated[int | None, typer.Option(help="Curves at a time. [default: one per core]", min=1)] = None,
    as_json: JsonOption = False,
) -> None:
    """Make the study of an archive again in a fresh folder, and say whether it is the same to the byte.

    Otherwise it says which numbers differ, and by how many of their uncertainties, and exits with 1. Nothing of the
    archive is executed; a plugin file that it names only with your consent, as of palpate trust.
    """
    with _place(out) as root:
        manifest = unpack(archive, root)
        _take_curves(archive, root, manifest, curves)
        try:
            _demand_harmless(archive, root)
        except ConsentError as error:
            told = str(error).replace(str(root), str(out or "FOLDER"))
            more = "" if out else f"; FOLDER is what palpate verify {shlex.quote(str(archive))} --out FOLDER unpacks"
            raise ConsentError(f"{told}{more}") from error
        with print_aside(as_json):
            found = _made_again(root / FITS, manifest, jobs)
    if as_json:
        print_json({"archive": archive, "same": found.passed, **found.__dict__})
    else:
        _show(archive, found)
    if not found.passed:
        raise typer.Exit(1)


@contextmanager
def _place(out: Path | None) -> Iterator[Path]:
    """A new folder, that stays where it is named."""
    if out is None:
        with TemporaryDirectory(prefix="palpate-") as place:
            yield Path(place).resolve()
        return
    try:
        out.mkdir(parents=True, exist_ok=True)
        if any(out.iterdir()):
            raise OutputError(f"{out}: is not empty, and nothing is ever overwritten")
    except OSError as error:
        raise OutputError(f"{out}: cannot write: {error.strerror}") from error
    yield out.resolve()


def _take_curves(archive: Path, root: Path, manifest: Manifest, curves: Path | None) -> None:
    """Copy the curves that the archive has hashes of, wherever they are below a folder; raises ConfigurationError."""
    if not manifest.left_out:
        return
    if curves is None or not curves.is_dir():
        told = (
            f"--curves {curves}: is not a folder"
            if curves
            else "has hashes of its curves only: name theirs, --curves FOLDER"
        )
        raise ConfigurationError(f"{archive}: {told}")
    names = {Path(name).name for name in manifest.left_out}
    known = {digest_of(path): path for path in sorted(curves.rglob("*")) if path.name in names and path.is_file()}
    if gone := [name for name, digest in manifest.left_out.items() if digest not in known]:
        raise ConfigurationError(f"--curves {curves}: {len(gone)} curves of the study are not there, such as {gone[0]}")
    for name, digest in manifest.left_out.items():
        target = root / name
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(known[digest], target)
        except OSError as error:
            raise LogError(f"{archive}: {name!r} cannot be copied: {error.strerror or error}") from error


def _demand_harmless(archive: Path, root: Path) -> None:
    """Raise LogError for settings that name a file outside, ConsentError for a plugin file that nobody has approved."""
    folder = FitFolder(root / FITS)
    if not folder.names:
        raise LogError(f"{archive}: has no curves")
    outside = f"{archive}: names a file outside of it"
    if (place := folder.curves_folder) is not None and not place.resolve().is_relative_to(root):
        raise LogError(f"{outside}, or a folder: [run] curves of {SETTINGS}")
    for name in folder.names:
        file = Path(folder.file_of(name))
        if not (file.resolve().is_relative_to(root) and file.exists()):
            raise LogError(f"{outside}, or that it has not: {printable(str(file))} of the curve {printable(name)}")
    for dialect, own in dict.fromkeys((folder.dialect_of(name), folder.settings_of(name)) for name in folder.names):
        source = Source(folder.settings_text(dialect), root / FITS / SETTINGS, enclosure=Enclosure(root / archive.name))
        for assignment in own:
            source.override(assignment)
        plugin_files(source)
        for device in build_pipeline(source).devices.values():
            log = getattr(device, "file", None)
            if not (isinstance(log, Path) and log.resolve().is_relative_to(root)):
                raise LogError(f"{outside}, or reads none: [device.*] of {SETTINGS}")


def _made_again(fits: Path, manifest: Manifest, jobs: int | None) -> Verification:
    """The folder of fits without its results, fitted and reported again, and compared with what was packed."""
    packed = {name: path.read_bytes() for name, path in files_below(fits).items()}
    before = fitted_rows(fits / TABLE)
    (fits / TABLE).unlink()
    write_rows(fits / TABLE, columns_of_fits(offline(dialect_pipeline(FitFolder(fits)))), ())
    with redirect_stdout(StringIO()), suppress(typer.Exit):  # of curves that cannot be fitted, which are rows, too
        analysis("fit")([fits], jobs=jobs)
    if PROVENANCE in packed:
        write_whole(fits / PROVENANCE, packed[PROVENANCE])
    made = [TABLE, *write_pages(fits, manifest.options)]
    same = [name for name in made if (fits / name).read_bytes() == packed.get(name)]
    differences = list(row_differences(before, fitted_rows(fits / TABLE)))
    here = library_versions()
    others = {
        name: (said, here.get(name, "none")) for name, said in manifest.versions.items() if here.get(name) != said
    }
    return Verification(
        len({row["curve"] for row in before}), manifest.versions.get("palpate", "?"), here["palpate"], others, same,
        [name for name in made if name not in same], differences,
    )  # fmt: skip


def _show(archive: Path, found: Verification) -> None:
    typer.echo(f"{archive}: {found.curves} curves, packed with palpate {found.packed_with}")
    if found.other_versions:
        told = ", ".join(f"{name} {here} (was {said})" for name, (said, here) in found.other_versions.items())
        typer.echo(f"this is another version: {told}")
    if not found.other_files:
        typer.echo(f"same to the byte: {', '.join(found.same_files)}")
        return
    if not found.differences:
        typer.echo(f"every number is the same; of other bytes: {', '.join(found.other_files)}")
        return
    ranked = sorted(found.differences, key=lambda one: -math.inf if one.in_u is None else -one.in_u)
    known = [one.in_u for one in ranked if one.in_u is not None]
    most = f", numbers by at most {max(known):.2g} u" if known else ""
    cells = "1 cell differs" if len(ranked) == 1 else f"{len(ranked)} cells differ"
    typer.echo(f"{TABLE}: {cells}{most}")
    for one in ranked[:_SHOWN]:
        by = "" if one.in_u is None else f" ({one.in_u:.2g} u)"
        pair = f"{one.packed or 'none'} packed, {one.found or 'none'} here"
        typer.echo(printable(f"  {one.curve} {one.column}: {pair}{by}"))
    if len(ranked) > _SHOWN:
        typer.echo(f"  and {len(ranked) - _SHOWN} more: --json shows all")
