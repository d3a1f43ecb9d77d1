"""The page as PDF, printed by a browser that is on the machine."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

from palpate import ConfigurationError, OutputError

_BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "microsoft-edge")
_TIMEOUT = 120.0  # [s] of a browser that prints: a choice


def print_pdf(page: Path, target: Path) -> None:
    """Print a page to a PDF; raises ConfigurationError without Chromium or Chrome, OutputError where it fails."""
    browser = next((path for name in _BROWSERS if (path := shutil.which(name))), None)
    if browser is None:
        raise ConfigurationError(
            f"--pdf: neither Chromium nor Chrome is on the PATH; open {page} in a browser and print it"
        )
    with TemporaryDirectory(prefix="palpate-print-") as folder:
        printed = Path(folder) / "report.pdf"
        command = [
            browser,
            "--headless",
            "--disable-gpu",
            "--disable-extensions",
            "--no-first-run",
            "--no-pdf-header-footer",
        ]
        command += [f"--user-data-dir={folder}/profile", f"--print-to-pdf={printed}"]
        # Root has no sandbox; the page is our own, lets no script but ours run, and may load nothing.
        command += ["--no-sandbox"] if os.geteuid() == 0 else []
        try:
            done = subprocess.run(
                [*command, page.resolve().as_uri()], capture_output=True, timeout=_TIMEOUT, check=False, text=True
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise OutputError(f"{target}: {browser} cannot print: {error}") from error
        if not printed.is_file():
            raise OutputError(f"{target}: {browser} printed nothing: {done.stderr.strip()[-300:]}")
        try:
            shutil.copyfile(printed, target)
        except OSError as error:
            raise OutputError(f"{target}: cannot write: {error.strerror}") from error
