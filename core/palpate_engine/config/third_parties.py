"""The installed distributions of third parties whose parts a pipeline has."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from palpate.flags import Flag
from palpate.parts import Part, Settings

from palpate_engine.config.pipeline import Pipeline


def third_party_versions(pipeline: Pipeline) -> dict[str, str]:
    """Return the version of each distribution, besides palpate's own, that a part of a pipeline is of."""
    kinds: tuple[Mapping[str, Any], ...] = (
        pipeline.devices,
        pipeline.surfaces,
        pipeline.trajectories,
        pipeline.indenters,
        pipeline.models,
        pipeline.estimators,
        pipeline.sinks,
        pipeline.twins,
    )
    # The classes of all parts, those within others included, then the plugins of others that these classes are of.
    part_classes = {type(part) for parts in kinds for top in parts.values() for part in _parts_in(top)}
    plugins = set()
    for part_class in part_classes:
        for entry in pipeline.registry.parts[part_class.kind].values():
            if entry.is_of(part_class) and not entry.plugin.own and not entry.plugin.is_file:
                plugins.add(entry.plugin)
    return {plugin.distribution: plugin.version for plugin in sorted(plugins, key=lambda plugin: plugin.name)}


def _parts_in(value: Any) -> Iterator[Part]:
    """Yield a part and every part in its settings."""
    if isinstance(value, Part):
        yield value
    if isinstance(value, Settings):
        for name in type(value).model_fields:
            yield from _parts_in(getattr(value, name))
    elif isinstance(value, dict):
        for item in value.values():
            yield from _parts_in(item)
    elif isinstance(value, tuple | list):
        for item in value:
            yield from _parts_in(item)


def setup_flags(pipeline: Pipeline) -> Iterator[Flag]:
    """Yield what every run states of its set-up: who was left out or takes the place of whom, and looser limits."""
    registry = pipeline.registry
    sentences = (*registry.left_out, *registry.older_names, *pipeline.looser_limits)
    yield from (Flag("device", sentence) for sentence in sentences)
    installed = third_party_versions(pipeline)
    for text in pipeline.run.distributions:
        name, _, version = text.partition(" ")
        if name in installed and installed[name] != version:
            yield Flag("device", f"resolved with {text}, and {name} {installed[name]} is installed")
