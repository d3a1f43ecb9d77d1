"""Configuration: a TOML file becomes a checked pipeline, or one clear list of what is wrong with it."""

from palpate.config.pipeline_file import Pipeline, RunSettings, Track, build_pipeline, load_pipeline
from palpate.config.plan import CalibrationPlan, load_plan
from palpate.config.resolved import plain_settings, resolved_text
from palpate.config.schema import pipeline_schema
from palpate.config.source import Source

__all__ = [
    "CalibrationPlan",
    "Pipeline",
    "RunSettings",
    "Source",
    "Track",
    "build_pipeline",
    "load_pipeline",
    "load_plan",
    "pipeline_schema",
    "plain_settings",
    "resolved_text",
]
