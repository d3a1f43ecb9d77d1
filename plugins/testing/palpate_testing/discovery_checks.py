"""Check of a plugin's module, which every command of palpate imports."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping

from palpate_testing.failure_messages import demand

SLOW_IMPORTS = ("casadi", "matplotlib", "numpy", "pydantic", "scipy")  # each takes as long as the help of all commands
# Import a module in a fresh process, and print the line of its package at which each slow import begins.
_PROGRAM = """
import importlib, json, sys, traceback
from pathlib import Path
module, slow = sys.argv[1], sys.argv[2:]
places = {}
class Watch:
    def find_spec(self, name, path=None, target=None):
        if name in slow and name not in places:
            frames = [frame for frame, _ in traceback.walk_stack(None)]
            own = [f for f in frames if str(f.f_globals.get("__name__")).partition(".")[0] == module.partition(".")[0]]
            places[name] = [f"{Path(f.f_code.co_filename).name}, line {f.f_lineno}" for f in own[:1]]
sys.meta_path.insert(0, Watch())
importlib.import_module(module)
print(json.dumps(places))
"""


def check_discovery(module: str) -> None:
    """Check that a plugin's module, by its name, is imported without numpy and other slow libraries.

    palpate imports the module of every installed plugin before any command, `palpate --help` included. A hook that
    names its parts as "module:Class", and types that are imported under TYPE_CHECKING, leave the libraries to the
    command that has the part. Raises AssertionError with the line at fault.
    """
    import_lines = slow_imports(module)
    libraries = ", ".join(f"{library} ({line})" if line else library for library, line in import_lines.items())
    remedy = 'name its parts as "module:Class", and import types under TYPE_CHECKING'
    complaint = f"{module} imports {libraries} where palpate looks for plugins, before every command: {remedy}"
    demand(not import_lines, complaint)


def slow_imports(module: str) -> Mapping[str, str]:
    """Return the slow libraries that are imported with a module, and the line of its package that imports each.

    A line is a text "file, line 3", or empty where no line of the package does. Raises AssertionError for a module that
    cannot be imported.
    """
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    command = [sys.executable, "-P", "-c", _PROGRAM, module, *SLOW_IMPORTS]
    process = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    last_line = process.stderr.strip().splitlines()[-1:]
    demand(process.returncode == 0, f"{module} cannot be imported: {' '.join(last_line)}")
    return {library: " ".join(lines) for library, lines in json.loads(process.stdout).items()}
