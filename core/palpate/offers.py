"""Offers of a plugin besides parts: commands, report sections, templates; plain data, nothing is imported for it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any, ClassVar

from palpate.errors import RAISED_BY_PARTS, PalpateError, PluginError

PANELS = {  # tasks, in the order of ``palpate --help``
    "begin": "Begin",
    "run": "Estimate elasticity and viscosity",
    "hardware": "Palpate with a robot",
    "compare": "Compare and repeat",
    "analyse": "Look deeper",
    "share": "Show others",
    "logs": "Read and write logs",
    "extend": "Look up and extend",
}


@dataclass(frozen=True)
class Offer:
    """A function of a plugin, for one command or one moment of a run."""

    target: str | Callable[..., Any]  # "module:function", imported when it is called; or the function


@dataclass(frozen=True)
class Command(Offer):
    """A command of ``palpate``: a function with typer annotations, imported when it is called.

    A name of two words, such as ``map lumps``, is a subcommand: `palpate map --help` shows it. The first word needs no
    command of its own, and may belong to another plugin.
    """

    help: str  # one line for `palpate --help`
    panel: str = "analyse"  # key of PANELS
    first_options: tuple[str, ...] = ()  # what --help shows; --help all shows every option. Empty: all are shown
    former_options: Mapping[str, str] = field(default_factory=dict)  # the words that replace options; those are refused
    hidden: bool = False  # for scripts: `palpate --help` leaves it out


@dataclass(frozen=True)
class ReportSection(Offer):
    """A section of a shown result: ``function(result)`` answers tables and texts, none where it has none."""

    order: int = 50  # sections are shown by increasing order
    detail: bool = False  # True: a terminal shows it only with --details; a report always does


class Report(Offer):
    """A file about a run that has ended: ``function(folder)`` writes it and answers its path."""


@dataclass(frozen=True)
class Diagnosis(Offer):
    """A judge of results: ``function(evidence of all tracks)`` answers findings by track; see `TrackEvidence`.

    It states `after` which diagnoses it runs: their findings are part of its evidence, and no others. `EVERY_OTHER`
    stands for all that do not state it themselves. A name that no family offers does not count.
    """

    EVERY_OTHER: ClassVar = "every other"

    after: tuple[str, ...] = ()
    quick: bool = False  # it is asked once a second while a run goes on, too
    lost: bool = False  # it is asked of tracks whose numbers are lost (NaN), too
    detail: bool = False  # True: its table is for details; a row of a table of fits is judged without it


class Summary(Offer):
    """A summary of each track while a run goes on: ``function()`` answers a `TrackSummary`."""


class Recorder(Offer):
    """A recorder of every run's estimates: ``function(folder, parameters by track, pipeline, offline)``.

    It answers a context with an `EstimatesWriter`. `pipeline` has its own table, and ``[run]
    estimates_interval``; `offline` tracks, which end with the record, are opened apart.
    """


class Check(Offer):
    """A check of parts before anything moves: ``function(parts by kind, registry)`` raises PluginError for a wrong one.

    `parts` holds for each kind of part those of a pipeline by their names.
    """


class Fact(Offer):
    """A line of ``palpate info`` on an installation: ``function()`` answers it, such as the kernel that runs."""


class FileSuggestion(Offer):
    """A suggestion of ``palpate info FILE --suggest`` for other files than logs: ``function(path)`` returns commands.

    It answers a sequence of commands, comments and blanks to fill in, and None for a file of another kind.
    """


class CalibrationReader(Offer):
    """A reader of ``[run] calibration``: ``function(path, valid for [s])`` answers the calibration of a file."""


class ControlReader(Offer):
    """A reader of ``[run] control``: ``function(path, valid for [s])`` answers the check of a chart behind a run."""


class Display(Offer):
    """A display of a run on the terminal: ``function(pipeline)`` answers a context with a writer with `progress`."""


@dataclass(frozen=True)
class Template:
    """A text that `palpate` writes for a user to fill in, from a plugin's package data."""

    package: str  # of the plugin: "my_filters"
    path: str  # within the package: "templates/point.toml"
    help: str  # one line

    def text(self) -> str:
        """Return the text; raises PluginError where the package lacks it."""
        from importlib.resources import files

        try:
            return files(self.package).joinpath(self.path).read_text(encoding="utf-8")
        except (OSError, ImportError) as error:
            raise PluginError(f"template {self.path} of {self.package} cannot be read: {error}") from error


def function_of(offer: Offer) -> Callable[..., Any]:
    """Return the function that an offer names; raises PluginError where it cannot be imported."""
    return import_target(offer.target) if isinstance(offer.target, str) else offer.target


def context_of(answer: Any, source: str) -> AbstractContextManager[Any]:
    """Return what a plugin answers if it is a context; raises PluginError, which names the `source`, if it is not."""
    if not isinstance(answer, AbstractContextManager):
        raise PluginError(f"{source} returns {answer!r}, not a context such as of contextlib.contextmanager")
    return answer


def import_target(target: str) -> Callable[..., Any]:
    """Return the object that ``module:name`` names; raises PluginError where it cannot be imported."""
    module, colon, name = target.partition(":")
    if not (module and colon and name):
        raise PluginError(f"{target!r} is not of the form MODULE:FUNCTION")
    try:
        target_object: Callable[..., Any] = getattr(import_module(module), name)
    except (ImportError, AttributeError) as error:
        raise PluginError(f"{target} cannot be imported: {error}") from error
    except PalpateError:
        raise
    except RAISED_BY_PARTS as error:  # whatever a third-party import raises
        raise PluginError(f"{target} cannot be imported: {type(error).__name__}: {error}") from error
    return target_object
