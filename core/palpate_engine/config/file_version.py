"""The version for which a pipeline file was written; a newer one is refused."""

from __future__ import annotations

import re

from palpate.errors import ConfigurationError

from palpate_engine.config.pipeline_source import Source

FORMAT = "0.2"  # version of palpate in whose names pipelines are written today
KEY = "palpate"  # of a pipeline, at the top: the version for which it was written


def demand_version(source: Source) -> str:
    """Return the version of a pipeline, that of today where it states none.

    Raises ConfigurationError for one of a newer palpate, or with an invalid version.
    """
    version = source.tables.get(KEY)
    if version is None:
        return FORMAT
    where = source.where((KEY,))
    if not isinstance(version, str) or not re.fullmatch(r"\d+\.\d+(\.\d+)?", version):
        raise ConfigurationError(f'{where}: {KEY} is {version!r}; write a version, such as {KEY} = "{FORMAT}"')
    if _version(version) > _version(FORMAT):
        problem = f'written for palpate {version}, but this palpate reads up to "{FORMAT}": update it'
        raise ConfigurationError(f"{where}: {problem}")
    return version


def _version(text: str) -> tuple[int, int]:
    """Return major and minor number of a version; a third one is not part of the format."""
    major, minor, *_ = text.split(".")
    return int(major), int(minor)
