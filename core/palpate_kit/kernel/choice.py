"""Choice of the kernel by which steps are run."""

from __future__ import annotations

import os
from functools import cache
from importlib.metadata import PackageNotFoundError, version

from palpate import ConfigurationError

VARIABLE = "PALPATE_KERNEL"


def kernel_choice() -> tuple[str, str]:
    """Return the kernel by which steps are run, "llvm" or "vm", and why; raises ConfigurationError for one that cannot
    be."""
    requested = os.environ.get(VARIABLE, "auto")
    if requested not in ("auto", "llvm", "vm"):
        raise ConfigurationError(f'environment variable {VARIABLE}: {requested!r} is not one of "auto", "llvm", "vm"')
    installed = _llvmlite()
    if installed is None:
        if requested == "llvm":
            raise ConfigurationError(f'{VARIABLE}=llvm: llvmlite is not installed; pip install "palpate[fast]"')
        return "vm", 'llvmlite is not installed; pip install "palpate[fast]" makes filters some ten times faster'
    if requested == "vm":
        return "vm", f"{VARIABLE}=vm asks for it"
    return "llvm", f"llvmlite {installed} is installed"


@cache
def _llvmlite() -> str | None:
    """Return the installed version; looking it up takes longer than a second of log."""
    try:
        return version("llvmlite")
    except PackageNotFoundError:
        return None
