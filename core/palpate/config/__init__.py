"""Configuration: a TOML file becomes a checked pipeline, or one clear list of what is wrong with it."""

from palpate.config.assumed_values import values_on_trust
from palpate.config.pipeline import CalibratedNumber, CalibrationUse, Pipeline, RunSettings, Track
from palpate.config.pipeline_file import build_parts, build_pipeline, load_pipeline, plugin_files
from palpate.config.pipeline_source import Source, parsed_assignment
from palpate.config.resolved_pipeline import plain_settings, resolved_text
from palpate.config.signal_wiring import ports_of, wrong_channels

__all__ = [
    "CalibratedNumber",
    "CalibrationUse",
    "Pipeline",
    "RunSettings",
    "Source",
    "Track",
    "build_parts",
    "build_pipeline",
    "load_pipeline",
    "parsed_assignment",
    "plain_settings",
    "plugin_files",
    "ports_of",
    "resolved_text",
    "values_on_trust",
    "wrong_channels",
]
