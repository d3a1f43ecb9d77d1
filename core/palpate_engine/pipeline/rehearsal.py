"""A rehearsal: a run in the simulated time of a twin, and never by the devices that the twin stands in for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from palpate.clocks import clock
from palpate.device import is_live
from palpate.errors import ConfigurationError

from palpate_engine.config import Pipeline, plain_settings
from palpate_engine.pipeline.rig import Rig


def refuse_rehearsal(rig: Rig) -> None:
    """Raise ConfigurationError where the live devices of a rehearsal would be reached in real time."""
    if rig.run.rehearsal is not None and is_live(rig.devices) and not clock().simulated:
        raise ConfigurationError(
            f"{rig.path}: is the pipeline of a rehearsal ([run] rehearsal), in simulated time: its devices are not "
            "reached; name the pipeline file of the rig itself"
        )


@contextmanager
def simulated_time(pipeline: Pipeline) -> Iterator[None]:
    """Let the context be in the simulated time of a rehearsal's twin, unless this process already uses one; change
    nothing for others.

    Raises ConfigurationError where the twin has none.
    """
    twin = pipeline.run.rehearsal
    if twin is None or not is_live(pipeline.devices) or clock().simulated:
        yield
    else:
        with pipeline.twins[twin].simulated(pipeline.run.seed):
            yield


def rehearsal_facts(pipeline: Pipeline, script: Mapping[str, Any] | None) -> dict[str, Any]:
    """Return ``run.rehearsal`` of a rehearsal, with its faults, hold-ups and seed; nothing of others."""
    twin = pipeline.run.rehearsal
    if twin is None or not is_live(pipeline.devices):
        return {}
    specimen = plain_settings(pipeline.twins[twin], pipeline.registry).get("specimen")
    script = script or {"faults": [], "hold_ups": [], "seed": pipeline.run.seed}
    return {"rehearsal": {"twin": twin, "specimen": specimen, **script}}
