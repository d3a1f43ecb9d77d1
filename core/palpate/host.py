"""The face for what uses pipelines: load one, run it, read its run folder, run an analysis of another plugin by name.

Parts need `palpate` only; commands and other tools use `palpate` and this.
"""

from collections.abc import Callable
from typing import Any

from palpate import registry
from palpate.alignment import GRAVITY, AlignmentSettings, Health, Intake, Ports, Series, Signal
from palpate.calibration import CalibratedValue, Calibration, NoiseSpectrum, identity_in, identity_of
from palpate.config import (
    Pipeline,
    RunSettings,
    Source,
    Track,
    build_parts,
    build_pipeline,
    load_pipeline,
    plain_settings,
    ports_of,
    resolved_text,
    wrong_channels,
)
from palpate.contact import force_slopes
from palpate.device import address, ask_devices, truth_of
from palpate.display import console, result_view
from palpate.flags import verdict
from palpate.installation import show_installation
from palpate.jobs import Engine, Job, built, finished, on_all_cores, run_job
from palpate.options import JsonOption, Overrides, PluginFiles, Points, TrackOption
from palpate.pictures import (
    FORMATS,
    WIDTHS,
    common_limits,
    figure_of,
    legend_outside,
    quartiles,
    save_figure,
    style,
)
from palpate.pipeline import (
    Flow,
    Result,
    continued,
    each,
    interruptible,
    recorded_pipeline,
    remaining_pipeline,
    run_pipeline,
    start_tracks,
    the_trajectory,
)
from palpate.quantities import measured
from palpate.registry import Registry, suggest
from palpate.replaying import Carried, carried_by, replay_source
from palpate.result import (
    Derived,
    EstimatesTable,
    Found,
    RunFolder,
    TrackResult,
    TrackTable,
    acceleration,
    differences,
    finite_tree,
    make_folder,
    read_flags,
    upgraded,
    withdraw_folder,
)
from palpate.safety import MotionLimits, Reach, SafetySettings, demand_safe
from palpate.suggesting import pipeline_of, recording_of, suggestion_of
from palpate.table import Table
from palpate.units import people
from palpate.writing import whole_file, write_new, write_whole


def analysis(name: str) -> Callable[..., Any]:
    """The function behind a subcommand, whichever plugin offers it; raises PluginError where none does."""
    return registry.load_commands({}).command(name).function()


__all__ = [
    "FORMATS",
    "GRAVITY",
    "WIDTHS",
    "AlignmentSettings",
    "CalibratedValue",
    "Calibration",
    "Carried",
    "Derived",
    "Engine",
    "EstimatesTable",
    "Flow",
    "Found",
    "Health",
    "Intake",
    "Job",
    "JsonOption",
    "MotionLimits",
    "NoiseSpectrum",
    "Overrides",
    "Pipeline",
    "PluginFiles",
    "Points",
    "Ports",
    "Reach",
    "Registry",
    "Result",
    "RunFolder",
    "RunSettings",
    "SafetySettings",
    "Series",
    "Signal",
    "Source",
    "Table",
    "Track",
    "TrackOption",
    "TrackResult",
    "TrackTable",
    "acceleration",
    "address",
    "analysis",
    "ask_devices",
    "build_parts",
    "build_pipeline",
    "built",
    "carried_by",
    "common_limits",
    "console",
    "continued",
    "demand_safe",
    "differences",
    "each",
    "figure_of",
    "finished",
    "finite_tree",
    "force_slopes",
    "identity_in",
    "identity_of",
    "interruptible",
    "legend_outside",
    "load_pipeline",
    "make_folder",
    "measured",
    "on_all_cores",
    "people",
    "pipeline_of",
    "plain_settings",
    "ports_of",
    "quartiles",
    "read_flags",
    "recorded_pipeline",
    "recording_of",
    "registry",
    "remaining_pipeline",
    "replay_source",
    "resolved_text",
    "result_view",
    "run_job",
    "run_pipeline",
    "save_figure",
    "show_installation",
    "start_tracks",
    "style",
    "suggest",
    "suggestion_of",
    "the_trajectory",
    "truth_of",
    "upgraded",
    "verdict",
    "whole_file",
    "withdraw_folder",
    "write_new",
    "write_whole",
    "wrong_channels",
]
