"""``palpate fit --each``: many curves that one pipeline reads, each a row of a table."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

import typer
from palpate import ConfigurationError, Device
from palpate_engine import (
    Pipeline,
    approved_plugins,
    load_pipeline,
    make_folder,
    parsed_assignment,
    registry,
    toml_tables,
)
from palpate_kit.curves.curve import Curve
from palpate_kit.curves.curve_fits import CurveReader, offline
from palpate_kit.curves.curve_list import stated_in
from palpate_kit.curves.curve_pool import on_cores
from palpate_kit.curves.curve_rows import CurveGroup, Pool, fit_rows, fit_stream, list_curves
from palpate_kit.curves.file_facts import file_facts
from palpate_kit.curves.fit_folder import FitFolder
from palpate_kit.curves.shared_specimen import setup_pairs
from palpate_kit.curves.stated_facts import StatedFacts, keep_facts, rig_beside, stated_facts
from palpate_kit.jobs.engines import demand_no_jobs
from palpate_kit.jobs.process_pool import core_count
from palpate_kit.terminal.layout import print_line

from palpate_fits.curve_files import curve_files, curves_by
from palpate_fits.fact_report import report_listed, report_rig
from palpate_fits.fit_request import FitRequest
from palpate_fits.fit_sources import log_device
from palpate_fits.folder_screen import show_folder
from palpate_fits.setup_tables import pairs_document


@dataclass(frozen=True)
class CurveFiles:
    """Files of curves and the one pipeline that reads them."""

    files: Sequence[Curve]
    pipeline: Pipeline
    assignments: tuple[str, ...]  # by which it was built
    device: str

    @property
    def logs(self) -> list[Device]:
        """The device of each file."""
        log = self.pipeline.devices[self.device]
        return [log.model_copy(update={"file": Path(curve.file)}) for curve in self.files]

    @property
    def reader(self) -> CurveReader:
        """The pipeline as any process builds it."""
        path = str(self.pipeline.path.resolve())
        return CurveReader(
            text=self.pipeline.text,
            path=path,
            overrides=self.assignments,
            device=self.device,
            approved=approved_plugins(),
        )


def fit_each(request: FitRequest) -> None:
    """Fit every curve by the one pipeline, and print what was found; exit 1 where one failed."""
    request = _with_rig(request)
    if request.scheduler is not None:
        _demand_seen_files(request)
    curves, stated = _curve_files(request), stated_facts(request.sources, request.overrides)
    if request.by is None:
        path = _fit_files(request, curves, stated)
    else:
        # One log, in which a channel separates the curves.
        path = _folder(request)
        stream = curves_by(curves.logs, request.by) if request.fitting else ()
        fit_stream(path, curves.pipeline, curves.reader, stream, _pool(request, path))
    keep_facts(path, stated)
    if request.fitting:
        _show(FitFolder(path), request)
    else:
        typer.echo(f"{len(curves.files)} curves to fit: palpate fit {path}")


def _with_rig(request: FitRequest) -> FitRequest:
    """Return the request with the file of facts next to the curves, where no other is named."""
    is_named = any(keys == ("run", "rig") for keys, _ in map(parsed_assignment, request.overrides))
    if request.pipeline is None or is_named or (rig := rig_beside(request.sources)) is None:
        return request
    report_rig([rig])
    return replace(request, overrides=(f"run.rig={json.dumps(str(rig.absolute()))}", *request.overrides))


def _demand_seen_files(request: FitRequest) -> None:
    """Raise ConfigurationError for what many curves on the workers of a scheduler cannot have."""
    for option, value in (("--by", request.by), ("--stage", request.stage)):
        if value:
            raise ConfigurationError(f"{option}: with --each, workers read each curve from a file that they can see")
    demand_no_jobs(request.jobs)


def _curve_files(request: FitRequest) -> CurveFiles:
    """Return the files that the pipeline reads; raises ConfigurationError."""
    if request.pipeline is None:
        raise ConfigurationError("--each: say with --pipeline FILE how a curve is read")
    reading = load_pipeline(request.pipeline, request.overrides)
    device = log_device(reading, request.pipeline)
    files = list(curve_files(request.sources, type(reading.devices[device])))
    assignments = (*request.overrides, f"device.{device}.file={json.dumps(str(files[0].file))}")
    pipeline = offline(load_pipeline(request.pipeline, assignments))
    pipeline = replace(pipeline, run=pipeline.run.model_copy(update={"curves": None}))  # of another folder of fits
    return CurveFiles(files, pipeline, assignments, device)


def _fit_files(request: FitRequest, curves: CurveFiles, stated: StatedFacts) -> Path:
    """Fit curves that are files by themselves, and return their folder of fits."""
    files = curves.files
    cells = file_facts(request.sources, files, stated).listed(files, toml_tables(curves.pipeline.text))
    report_listed(map(stated_in, cells.values()), len(files))
    path = _folder(request)
    folder = list_curves(path, [CurveGroup(curves.pipeline, curves.device, [*files])], cells)
    if request.fitting:
        names = [curve.name for curve in files]
        fit_rows(folder, names, pool=_pool(request, path), order=names)
    return path


def _folder(request: FitRequest) -> Path:
    return request.out or make_folder("fit", None, datetime.now(UTC).astimezone())


def _pool(request: FitRequest, path: Path) -> Pool:
    """Return what fits curves: the workers of a scheduler, or processes of this machine."""
    if request.scheduler is None:
        return partial(on_cores, workers=request.jobs or core_count())
    from palpate_fits.curve_cluster import on_workers

    return partial(on_workers, request.scheduler, path.resolve())


def _show(folder: FitFolder, request: FitRequest) -> None:
    """Print the folder of fits; exit 1 where a fit failed."""
    tracks, pairs = folder.summary, setup_pairs(folder, folder.names, registry.load())
    if request.as_json:
        document = {"table": str(folder.table), "tracks": tracks, "specimens": pairs_document(pairs)}
        typer.echo(json.dumps(document, indent=2))
    else:
        show_folder(folder, pairs, {}, request.details)
        print_line(f"every number: {folder.table}")
    if failed := sum(track["failed"] for track in tracks.values()):
        typer.echo(f"{failed} fits of {sum(track['curves'] for track in tracks.values())} failed", err=True)
        raise typer.Exit(1)
