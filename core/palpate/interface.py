"""The promised interface: its number, and the names that go."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

API = 1  # rises with each change that a plugin has to follow
OLDEST_API = 1  # that is understood: a number is kept for two MINOR versions after the next one
STATED_BY = "PALPATE_API"  # of a plugin's module
ASSUMED_API = 1  # of a plugin that states none

# Names of `palpate` that palpate's own arms, clocks, diagnoses and recorders share, and no part of others needs.
NOT_PROMISED = frozenset((
    "CalibrationReader", "ControlReader", "Display", "EstimatesWriter", "ForceWatch", "LastDigit", "Layout",
    "Recorder", "RepeatCount", "Repeats", "SampleStore", "SeparateReceiver", "Shareable", "SharedReadings", "Summary",
    "SupportsSharing", "Tail", "Thread", "finite_rows", "rotation_rows", "torque_fault", "turned_axes", "use_clock",
))  # fmt: skip
WHOLE = ("palpate", "palpate_engine", "palpate_testing")  # of which every other public name is promised
# Of other packages, by module: what readers of logs, drivers, commands and report sections need.
PROMISED = {
    "palpate_kit.runs.run_folder": ("RunFolder",),
    "palpate_kit.runs.continuation": ("recorded_pipeline",),
    "palpate_kit.runs.review_file": ("read_marks", "write_mark"),
    "palpate_kit.runs.calibration_file": ("Calibration", "CalibratedValue"),
    "palpate_kit.terminal.table": ("Table", "console"),
    "palpate_kit.terminal.options": ("FolderOption", "FormatOption", "JsonOption", "Overrides", "TrackOption"),
    "palpate_kit.terminal.json_output": ("print_json",),
    "palpate_kit.acquisition.sensor_process": ("SensorProcess",),
    "palpate_kit.acquisition.sensor_reader": ("Reading", "SensorReader", "received"),
    "palpate_kit.acquisition.device_lock": ("network_device",),
    "palpate_kit.acquisition.computer": ("host", "real_time"),
    "palpate_kit.kinematics.arm_model": ("ArmModel", "DHJoint"),
    "palpate_kit.kinematics.work_frame": ("WorkFrame",),
    "palpate_kit.kinematics.rotations": ("matrix_of", "pose_of", "rotation_matrix"),
    "palpate_kit.kernel": ("Step", "compile_step"),
    "palpate_kit.numerics.material_laws": ("LinearLaw",),
    "palpate_records.recording": ("Recording", "Suggestion", "Survey", "TopicSurvey"),
    "palpate_records": ("McapFile", "tables_of"),
    "palpate_arms.arm_driver": ("KINEMATICS_TOLERANCE", "ArmDriver", "ArmFaultError", "ArmReading"),
    "palpate_arms.arm_device": ("ArmDevice",),
}
PACKAGES = ("palpate", "palpate_arms", "palpate_engine", "palpate_kit", "palpate_records", "palpate_testing")

# Modules and names that go, by their full name: what replaces them, and the version in which they are gone.
DEPRECATED = {"palpate.host": ("palpate_engine", "0.3.0")}


@dataclass(frozen=True)
class DeprecatedUse:
    """A name that goes, and a plugin's file and line that use it."""

    name: str
    replacement: str
    gone_in: str  # version
    place: str  # "tips.py, line 3"


@dataclass(frozen=True)
class UnpromisedUse:
    """A name that may change with any version, and a plugin's file and line that use it."""

    name: str
    place: str  # "tips.py, line 3"


def interface_problem(module: ModuleType) -> str:
    """Return why the interface that a plugin's module states is not understood; empty where it is."""
    stated = stated_api(module)
    if stated is None or (isinstance(stated, int) and OLDEST_API <= stated <= API):
        return ""
    numbers = f"{API}" if OLDEST_API == API else f"{OLDEST_API} to {API}"
    return f"{STATED_BY} is {stated!r}, and this palpate knows {numbers}: install a palpate or a plugin that fits"


def stated_api(module: object) -> Any:
    """Return the number that a plugin's module states; None without one."""
    return vars(module).get(STATED_BY)  # not by `getattr`, for which a family looks for similar names


def deprecated_uses(place: str) -> Iterator[DeprecatedUse]:
    """Yield the names that go which the files of a plugin import, by the file of its module."""
    for name, line in _imports_of(place):
        if goes := _deprecated(name):
            yield DeprecatedUse(goes, *DEPRECATED[goes], line)


def unpromised_uses(place: str) -> Iterator[UnpromisedUse]:
    """Yield the names of palpate that nobody promises and the files of a plugin import, by the file of its module."""
    for name, line in _imports_of(place):
        package = name.partition(".")[0]
        if package in PACKAGES and not _deprecated(name) and not _is_promised(name):
            yield UnpromisedUse(name, line)


def _deprecated(name: str) -> str:
    """Return the module or name that goes and has a full name; empty if none goes."""
    return next((goes for goes in DEPRECATED if name == goes or name.startswith(f"{goes}.")), "")


def _is_promised(name: str) -> bool:
    """Return True for a full name such as ``palpate.Indenter`` that is kept for two MINOR versions."""
    module, _, last = name.rpartition(".")
    if module in WHOLE or not module:
        return not (module == "palpate" and last in NOT_PROMISED)
    return last in PROMISED.get(module, ())


def _imports_of(place: str) -> Iterator[tuple[str, str]]:
    """Yield the full name of each import in the files of a plugin, with file and line."""
    path = Path(place)
    files = sorted(path.parent.rglob("*.py")) if path.name == "__init__.py" else [path]
    for file in files:
        try:
            tree = ast.parse(file.read_text(encoding="utf-8"))
        except (OSError, SyntaxError, ValueError):  # whoever imports it reports that
            continue
        yield from ((name, f"{file.name}, line {line}") for name, line in _imported_names(tree))


def _imported_names(tree: ast.AST) -> Iterator[tuple[str, int]]:
    """Yield the full name of each import with its line."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield from ((f"{node.module}.{alias.name}", node.lineno) for alias in node.names)
