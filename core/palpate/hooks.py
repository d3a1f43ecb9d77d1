"""The whole plugin interface: what a plugin's module may offer.

A plugin is a module named in the entry-point group ``palpate`` of its distribution, or a file named in
``[run] plugins``. It offers parts by functions of the names below, each marked ``@palpate.plugin``::

    from palpate import plugin

    @plugin
    def palpate_indenters():
        return {"my-tip": MyTip}
"""

from __future__ import annotations

from collections.abc import Mapping

import pluggy

from palpate.contact import ContactModel, Indenter
from palpate.device import Device
from palpate.estimation import Estimator
from palpate.sink import Sink
from palpate.trajectory import Trajectory
from palpate.twin import Twin

PROJECT = "palpate"
plugin = pluggy.HookimplMarker(PROJECT)
_hook = pluggy.HookspecMarker(PROJECT)


@_hook
def palpate_indenters() -> Mapping[str, type[Indenter]]:  # type: ignore[empty-body]
    """Tips, by the name that ``[indenter.*] type = "..."`` gives them."""


@_hook
def palpate_models() -> Mapping[str, type[ContactModel]]:  # type: ignore[empty-body]
    """Contact models, by the name that ``[model.*] type = "..."`` gives them."""


@_hook
def palpate_estimators() -> Mapping[str, type[Estimator]]:  # type: ignore[empty-body]
    """Filters and fits, by the name that ``[estimator.*] type = "..."`` gives them."""


@_hook
def palpate_devices() -> Mapping[str, type[Device]]:  # type: ignore[empty-body]
    """Robots, sensors, simulated rigs and logs, by the name that ``[device.*] type = "..."`` gives them."""


@_hook
def palpate_trajectories() -> Mapping[str, type[Trajectory]]:  # type: ignore[empty-body]
    """Motions, by the name that ``[trajectory.*] type = "..."`` gives them."""


@_hook
def palpate_sinks() -> Mapping[str, type[Sink]]:  # type: ignore[empty-body]
    """Places to write to, by the name that ``[sink.*] type = "..."`` gives them."""


@_hook
def palpate_twins() -> Mapping[str, type[Twin]]:  # type: ignore[empty-body]
    """Devices in software, by the name that ``[twin.*] type = "..."`` gives them."""


# Kind of part -> (hook, class that its parts derive from).
KINDS = {
    "indenter": ("palpate_indenters", Indenter),
    "model": ("palpate_models", ContactModel),
    "estimator": ("palpate_estimators", Estimator),
    "device": ("palpate_devices", Device),
    "trajectory": ("palpate_trajectories", Trajectory),
    "sink": ("palpate_sinks", Sink),
    "twin": ("palpate_twins", Twin),
}
