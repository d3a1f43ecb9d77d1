"""Which kernel steps are run by."""

from __future__ import annotations

import os
from functools import cache
from importlib.metadata import PackageNotFoundError, version

from palpate import ConfigurationError

VARIABLE = "PALPATE_KERNEL"


def kernel_choice() -> tuple[str, str]:
    """Which kernel steps are run by, "llvm" or "vm", and why."""
    wanted = os.environ.get(VARIABLE, "auto")
    if wanted not in ("auto", "llvm", "vm"):
        raise ConfigurationError(f'environment variable {VARIABLE}: {wanted!r} is not one of "auto", "llvm", "vm"')
    found = _llvmlite()
    if found is None:
        if wanted == "llvm":
            raise ConfigurationError(f'{VARIABLE}=llvm: llvmlite is not installed; pip install "palpate[fast]"')
        return "vm", 'llvmlite is not installed; pip install "palpate[fast]" makes filters some ten times faster'
    if wanted == "vm":
        return "vm", f"{VARIABLE}=vm asks for it"
    return "llvm", f"llvmlite {found} is installed"


@cache
def _llvmlite() -> str | None:
    """Return the installed version; looking it up takes longer than a second of log."""
    try:
        return version("llvmlite")
    except PackageNotFoundError:
        return None
