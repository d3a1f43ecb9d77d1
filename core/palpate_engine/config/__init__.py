"""Configuration: a TOML file becomes a checked pipeline, or one clear list of what is wrong with it."""

from palpate_engine.config.assumed_values import values_on_trust
from palpate_engine.config.pipeline import CalibratedNumber, CalibrationUse, Pipeline, RunSettings, Track
from palpate_engine.config.pipeline_file import build_parts, build_pipeline, load_pipeline, plugin_files
from palpate_engine.config.pipeline_source import Source, parsed_assignment
from palpate_engine.config.resolved_pipeline import plain_settings, resolved_text
from palpate_engine.config.signal_wiring import ports_of, wrong_channels
from palpate_engine.config.third_parties import setup_flags, third_party_versions

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
    "setup_flags",
    "third_party_versions",
    "values_on_trust",
    "wrong_channels",
]
