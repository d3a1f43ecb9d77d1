"""The whole plugin interface: the offers of a plugin's module.

A plugin is a module named in the entry-point group ``palpate`` of its distribution, or a file named in
``[run] plugins``. It offers parts, commands and more by functions of the names below, each marked
``@palpate.plugin``::

    from palpate import plugin

    @plugin
    def palpate_indenters():
        return {"my-tip": MyTip}
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import pluggy

from palpate.offers import import_target

if TYPE_CHECKING:
    from palpate.contact import ContactModel, Indenter
    from palpate.device import Device
    from palpate.estimation import Estimator
    from palpate.flags import FlagMeaning
    from palpate.offers import Command, Diagnosis, Fact, Offer, ReportSection, Template
    from palpate.parts import Part, Settings
    from palpate.sink import Sink
    from palpate.surface import Surface
    from palpate.trajectory import Trajectory
    from palpate.twin import Twin

PROJECT = "palpate"
plugin = pluggy.HookimplMarker(PROJECT)
_hook = pluggy.HookspecMarker(PROJECT)


@_hook
def palpate_indenters() -> Mapping[str, type[Indenter] | str]:  # type: ignore[empty-body]
    """Tips, by the name that ``[indenter.*] type = "..."`` gives them.

    Like every part, a class, or ``"module:Class"``, which is imported when a pipeline asks for it.
    """


@_hook
def palpate_models() -> Mapping[str, type[ContactModel] | str]:  # type: ignore[empty-body]
    """Contact models, by the name that ``[model.*] type = "..."`` gives them."""


@_hook
def palpate_estimators() -> Mapping[str, type[Estimator] | str]:  # type: ignore[empty-body]
    """Filters and fits, by the name that ``[estimator.*] type = "..."`` gives them."""


@_hook
def palpate_devices() -> Mapping[str, type[Device] | str]:  # type: ignore[empty-body]
    """Robots, sensors, simulated rigs and logs, by the name that ``[device.*] type = "..."`` gives them."""


@_hook
def palpate_trajectories() -> Mapping[str, type[Trajectory] | str]:  # type: ignore[empty-body]
    """Motions, by the name that ``[trajectory.*] type = "..."`` gives them."""


@_hook
def palpate_surfaces() -> Mapping[str, type[Surface] | str]:  # type: ignore[empty-body]
    """Skins of specimens, by the name that ``[surface.*] type = "..."`` gives them."""


@_hook
def palpate_sinks() -> Mapping[str, type[Sink] | str]:  # type: ignore[empty-body]
    """Places to write to, by the name that ``[sink.*] type = "..."`` gives them."""


@_hook
def palpate_twins() -> Mapping[str, type[Twin] | str]:  # type: ignore[empty-body]
    """Devices in software, by the name that ``[twin.*] type = "..."`` gives them."""


@_hook
def palpate_diagnoses() -> Mapping[str, Diagnosis]:  # type: ignore[empty-body]
    """Functions that judge the findings of a run's tracks, by name; each is called once when a run has ended.

    Their answers join the track's flags and its budget of uncertainty, and ``diagnoses.NAME`` of its result.
    """


@_hook
def palpate_offers() -> Mapping[str, Mapping[str, Offer]]:  # type: ignore[empty-body]
    """Offers for one command, or one moment of a run: by kind, by name, as in ``{"check": {"blunt": Check(blunt)}}``.

    - ``calibration``: reads the file of ``[run] calibration``; of several that of a file is used, then palpate's own.
    - ``check``: is called with the parts of each pipeline that is built, and refuses wrong ones.
    - ``control chart``: reads the chart of ``[run] control``; of several that of a file is used, then palpate's own.
    - ``display``: shows a run on the terminal while it goes on; of several that of a file is used, then palpate's own.
    - ``file suggestion``: what can be done with a file that is not a log, for ``palpate info FILE --suggest``.
    - ``recorder``: writes down the estimates of every run, in addition to the sinks that a pipeline requests.
    - ``report``: what ``palpate run --report`` makes of a run, by the name of the command that makes it later, too.
    - ``summary``: what is gathered of every track while it runs, such as values over the places of a sweep.
    """


@_hook
def palpate_facts() -> Mapping[str, Fact]:  # type: ignore[empty-body]
    """Lines for ``palpate info`` without a log, by name."""


@_hook
def palpate_commands() -> Mapping[str, Command]:  # type: ignore[empty-body]
    """Subcommands of ``palpate`` by name; their modules are imported when they are called."""


@_hook
def palpate_tables() -> Mapping[str, type[Settings]]:  # type: ignore[empty-body]
    """Tables of a pipeline file by name, such as ``[sweep]``: settings of an analysis, found in `Pipeline.tables`."""


@_hook
def palpate_report_sections() -> Mapping[str, ReportSection]:  # type: ignore[empty-body]
    """Sections that are shown of a result besides its table of tracks, by name."""


@_hook
def palpate_templates() -> Mapping[str, Template]:  # type: ignore[empty-body]
    """Texts for a user to begin with, such as a commented pipeline, by name."""


@_hook
def palpate_flags() -> Mapping[str, FlagMeaning]:  # type: ignore[empty-body]
    """Severity, meaning and remedy of each flag that the plugin's parts raise, by the flag's code.

    Flags that the core registers (`palpate describe`) may be raised by any part and are not repeated.
    """


_EXTENSIONS = {
    "command": ("palpate_commands", "palpate.offers:Command"),
    "table": ("palpate_tables", "palpate.parts:Settings"),
    "report section": ("palpate_report_sections", "palpate.offers:ReportSection"),
    "template": ("palpate_templates", "palpate.offers:Template"),
    "diagnosis": ("palpate_diagnoses", "palpate.offers:Diagnosis"),
    "fact": ("palpate_facts", "palpate.offers:Fact"),
    "flag": ("palpate_flags", "palpate.flags:FlagMeaning"),
}
_OFFERS = {
    "calibration": ("calibrations", "palpate.offers:CalibrationReader"),
    "check": ("checks", "palpate.offers:Check"),
    "control chart": ("controls", "palpate.offers:ControlReader"),
    "display": ("displays", "palpate.offers:Display"),
    "file suggestion": ("file_suggestions", "palpate.offers:FileSuggestion"),
    "recorder": ("recorders", "palpate.offers:Recorder"),
    "report": ("reports", "palpate.offers:Report"),
    "summary": ("summaries", "palpate.offers:Summary"),
}
_KINDS = {
    "indenter": ("palpate_indenters", "palpate.contact:Indenter"),
    "model": ("palpate_models", "palpate.contact:ContactModel"),
    "estimator": ("palpate_estimators", "palpate.estimation:Estimator"),
    "device": ("palpate_devices", "palpate.device:Device"),
    "trajectory": ("palpate_trajectories", "palpate.trajectory:Trajectory"),
    "surface": ("palpate_surfaces", "palpate.surface:Surface"),
    "sink": ("palpate_sinks", "palpate.sink:Sink"),
    "twin": ("palpate_twins", "palpate.twin:Twin"),
}
PART_KINDS = tuple(_KINDS)

if TYPE_CHECKING:
    # What a plugin offers besides parts -> (hook, class that each must be, or derive from where it is a class).
    EXTENSIONS: Mapping[str, tuple[str, type]]
    # Kind of what `palpate_offers` returns -> (its field of the registry, class that each must be).
    OFFERS: Mapping[str, tuple[str, type]]
    # Kind of part -> (hook, class that its parts derive from).
    KINDS: Mapping[str, tuple[str, type[Part]]]


def __getattr__(name: str) -> Any:
    """Return KINDS, EXTENSIONS or OFFERS with their classes, which are imported on first use."""
    tables = {"KINDS": _KINDS, "EXTENSIONS": _EXTENSIONS, "OFFERS": _OFFERS}
    if name not in tables:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    table = {key: (hook, import_target(root)) for key, (hook, root) in tables[name].items()}
    globals()[name] = table
    return table
