"""``palpate pack``: a folder of fits as one file, with everything that a reader needs to make it again."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer
from palpate import ConfigurationError
from palpate_engine import library_versions, write_whole
from palpate_kit.curves.fit_folder import FitFolder, is_fit_folder
from palpate_kit.terminal.progress import progress

from palpate_studies.archive.archive_file import (
    CURVES,
    FITS,
    MANIFEST,
    Manifest,
    digest_of,
    files_below,
    write_archive,
)
from palpate_studies.archive.study_folder import write_study
from palpate_studies.archive.study_pages import write_pages


def pack(
    folder: Annotated[Path, typer.Argument(metavar="FITS", help="A folder of fits of many curves.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="The archive to write, such as study.zip.")],
    by: Annotated[
        str | None, typer.Option(metavar="COLUMN", help="Groups of its report, by a column of curves.csv.")
    ] = None,
    hashes: Annotated[
        bool, typer.Option("--hashes", help="Leave the curves out, and pack their SHA-256: palpate verify --curves.")
    ] = False,
) -> None:
    """Pack a folder of fits with its curves, settings, marks, history, report and methods into one file.

    No name of a folder of this machine is in it, and the same study gives the same bytes. `palpate verify` makes it
    again from the curves.
    """
    if not is_fit_folder(folder):
        raise ConfigurationError(f"{folder}: is not a folder of fits: it has no fits.csv")
    if out.suffix != ".zip":
        raise ConfigurationError(f"--out {out}: an archive's name ends in .zip")
    options = {"by": by} if by else {}
    with progress(f"pack {folder}"), TemporaryDirectory(prefix="palpate-") as temporary_folder:
        root = Path(temporary_folder)
        # The folder of fits and what it names, with its pages.
        write_study(FitFolder(folder), root)
        write_pages(root / FITS, options)
        # The hashes of all files; curves that are left out keep theirs.
        digests = {name: digest_of(path) for name, path in files_below(root).items()}
        left_out = {name: digest for name, digest in digests.items() if hashes and name.startswith(f"{CURVES}/")}
        for name in left_out:
            (root / name).unlink()
        packed = {name: digest for name, digest in digests.items() if name not in left_out}
        write_whole(root / MANIFEST, Manifest(library_versions(), options, files=packed, left_out=left_out).text)
        write_archive(root, out)
    typer.echo(f"{out}: {len(packed)} files, SHA-256 {digest_of(out)}")
    typer.echo(f"to check it: palpate verify {out}{' --curves FOLDER' if left_out else ''}")
