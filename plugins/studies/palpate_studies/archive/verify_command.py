"""``palpate verify``: the study of an archive made again from its curves, and compared."""

from __future__ import annotations

import math
import shlex
import shutil
from collections.abc import Iterator, Sequence
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

_MAX_DIFFERENCES = 20  # that are shown, a choice: a screen


@dataclass(frozen=True)
class Verification:
    """The comparison of a packed study with the one that was made again."""

    curves: int  # how many
    packed_with: str  # version of palpate
    this: str  # version of palpate
    other_versions: dict[str, tuple[str, str]]  # by library on which numbers depend: packed with, and here
    same_files: list[str]  # to the byte
    other_files: list[str]
    differences: list[RowDifference]  # of the tables of fits

    @property
    def passed(self) -> bool:
        """True if all files are the same to the byte; for another version of palpate, if every number is the same."""
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
    with _empty_folder(out) as root:
        manifest = unpack(archive, root)
        _copy_curves(archive, root, manifest, curves)
        try:
            _demand_harmless(archive, root)
        except ConsentError as error:
            # A temporary folder is of no use to a person, who unpacks the archive to look at the plugin file.
            problem = str(error).replace(str(root), str(out or "FOLDER"))
            advice = "" if out else f"; FOLDER is what palpate verify {shlex.quote(str(archive))} --out FOLDER unpacks"
            raise ConsentError(f"{problem}{advice}") from error
        with print_aside(as_json):
            verification = _verify_fits(root / FITS, manifest, jobs)
    if as_json:
        print_json({"archive": archive, "same": verification.passed, **verification.__dict__})
    else:
        _print_verification(archive, verification)
    if not verification.passed:
        raise typer.Exit(1)


@contextmanager
def _empty_folder(out: Path | None) -> Iterator[Path]:
    """Make an empty folder, without a name a temporary one; raises OutputError for a folder that is not empty."""
    if out is None:
        with TemporaryDirectory(prefix="palpate-") as temporary_folder:
            yield Path(temporary_folder).resolve()
        return
    try:
        out.mkdir(parents=True, exist_ok=True)
        if any(out.iterdir()):
            raise OutputError(f"{out}: is not empty, and nothing is ever overwritten")
    except OSError as error:
        raise OutputError(f"{out}: cannot write: {error.strerror}") from error
    yield out.resolve()


def _copy_curves(archive: Path, root: Path, manifest: Manifest, curves: Path | None) -> None:
    """Copy the curves that an archive has hashes of to their names below `root`, from anywhere below a folder `curves`.

    Raises ConfigurationError without that folder, and if it lacks a curve, LogError if one cannot be copied.
    """
    if not manifest.left_out:
        return
    if curves is None:
        raise ConfigurationError(f"{archive}: has hashes of its curves only: name theirs, --curves FOLDER")
    if not curves.is_dir():
        raise ConfigurationError(f"{archive}: --curves {curves}: is not a folder")
    # Curves are found by their hashes, among files of their names: a folder may hold much else.
    names = {Path(name).name for name in manifest.left_out}
    files = {digest_of(path): path for path in sorted(curves.rglob("*")) if path.name in names and path.is_file()}
    missing = [name for name, digest in manifest.left_out.items() if digest not in files]
    if missing:
        raise ConfigurationError(
            f"--curves {curves}: {len(missing)} curves of the study are not there, such as {missing[0]}"
        )
    for name, digest in manifest.left_out.items():
        target = root / name
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(files[digest], target)
        except OSError as error:
            raise LogError(f"{archive}: {name!r} cannot be copied: {error.strerror or error}") from error


def _demand_harmless(archive: Path, root: Path) -> None:
    """Raise LogError for settings that name a file outside, ConsentError for a plugin file that nobody has approved."""
    folder = FitFolder(root / FITS)
    if not folder.names:
        raise LogError(f"{archive}: has no curves")
    problem = f"{archive}: names a file outside of it"
    curves_folder = folder.curves_folder
    if curves_folder is not None and not curves_folder.resolve().is_relative_to(root):
        raise LogError(f"{problem}, or a folder: [run] curves of {SETTINGS}")
    for name in folder.names:
        file = Path(folder.file_of(name))
        if not (file.resolve().is_relative_to(root) and file.exists()):
            raise LogError(f"{problem}, or that it has not: {printable(str(file))} of the curve {printable(name)}")
    # Each pipeline that reads curves, with the settings of single curves.
    pipelines = dict.fromkeys((folder.dialect_of(name), folder.settings_of(name)) for name in folder.names)
    for dialect, own_settings in pipelines:
        source = Source(folder.settings_text(dialect), root / FITS / SETTINGS, enclosure=Enclosure(root / archive.name))
        for assignment in own_settings:
            source.override(assignment)
        plugin_files(source)  # raises ConsentError
        for device in build_pipeline(source).devices.values():
            log = getattr(device, "file", None)
            if not (isinstance(log, Path) and log.resolve().is_relative_to(root)):
                raise LogError(f"{problem}, or reads none: [device.*] of {SETTINGS}")


def _verify_fits(fits: Path, manifest: Manifest, jobs: int | None) -> Verification:
    """Fit and report the curves of a folder of fits again, and return the comparison with the packed results."""
    packed_files = {name: path.read_bytes() for name, path in files_below(fits).items()}
    packed_rows = fitted_rows(fits / TABLE)
    # An empty table of fits, which fitting fills.
    (fits / TABLE).unlink()
    write_rows(fits / TABLE, columns_of_fits(offline(dialect_pipeline(FitFolder(fits)))), ())
    with redirect_stdout(StringIO()), suppress(typer.Exit):  # of curves that cannot be fitted, which are rows, too
        analysis("fit")([fits], jobs=jobs)
    # Pages state the provenance of the packed fits.
    if PROVENANCE in packed_files:
        write_whole(fits / PROVENANCE, packed_files[PROVENANCE])
    new_files = [TABLE, *write_pages(fits, manifest.options)]
    same_files = [name for name in new_files if (fits / name).read_bytes() == packed_files.get(name)]
    versions = library_versions()
    other_versions: dict[str, tuple[str, str]] = {}
    for name, packed_version in manifest.versions.items():
        if versions.get(name) != packed_version:
            other_versions[name] = packed_version, versions.get(name, "none")
    return Verification(
        curves=len({row["curve"] for row in packed_rows}),
        packed_with=manifest.versions.get("palpate", "?"),
        this=versions["palpate"],
        other_versions=other_versions,
        same_files=same_files,
        other_files=[name for name in new_files if name not in same_files],
        differences=list(row_differences(packed_rows, fitted_rows(fits / TABLE))),
    )


def _print_verification(archive: Path, verification: Verification) -> None:
    """Print versions and files, then the cells that differ, those by the most uncertainties first."""
    typer.echo(f"{archive}: {verification.curves} curves, packed with palpate {verification.packed_with}")
    if verification.other_versions:
        versions = [
            f"{name} {present} (was {packed})" for name, (packed, present) in verification.other_versions.items()
        ]
        typer.echo(f"this is another version: {', '.join(versions)}")
    if not verification.other_files:
        typer.echo(f"same to the byte: {', '.join(verification.same_files)}")
        return
    if not verification.differences:
        typer.echo(f"every number is the same; of other bytes: {', '.join(verification.other_files)}")
        return
    _print_differences(verification.differences)


def _print_differences(differences: Sequence[RowDifference]) -> None:
    """Print the number of cells that differ, and the first: words, then numbers by their distance."""
    ranked = sorted(differences, key=lambda cell: -math.inf if cell.in_u is None else -cell.in_u)
    distances = [cell.in_u for cell in ranked if cell.in_u is not None]
    max_distance = f", numbers by at most {max(distances):.2g} u" if distances else ""
    count = "1 cell differs" if len(ranked) == 1 else f"{len(ranked)} cells differ"
    typer.echo(f"{TABLE}: {count}{max_distance}")
    for cell in ranked[:_MAX_DIFFERENCES]:
        distance = "" if cell.in_u is None else f" ({cell.in_u:.2g} u)"
        pair = f"{cell.packed or 'none'} packed, {cell.found or 'none'} here"
        typer.echo(printable(f"  {cell.curve} {cell.column}: {pair}{distance}"))
    if len(ranked) > _MAX_DIFFERENCES:
        typer.echo(f"  and {len(ranked) - _MAX_DIFFERENCES} more: --json shows all")
