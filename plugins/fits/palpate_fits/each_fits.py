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


def fit_each(asked: FitRequest) -> None:
    """Fit every curve by the one pipeline, and print what was found; exit 1 where one failed."""
    asked = _with_rig(asked)
    if asked.scheduler is not None:
        _demand_seen_files(asked)
    curves, stated = _curve_files(asked), stated_facts(asked.sources, asked.overrides)
    if asked.by is None:
        path = _fit_files(asked, curves, stated)
    else:
        path = _folder(asked)
        stream = curves_by(curves.logs, asked.by) if asked.fitting else ()
        fit_stream(path, curves.pipeline, curves.reader, stream, _pool(asked, path))
    keep_facts(path, stated)
    if asked.fitting:
        _show(FitFolder(path), asked)
    else:
        typer.echo(f"{len(curves.files)} curves to fit: palpate fit {path}")


def _with_rig(asked: FitRequest) -> FitRequest:
    """Return the request with the file of facts next to the curves, where no other is named."""
    is_named = any(keys == ("run", "rig") for keys, _ in map(parsed_assignment, asked.overrides))
    if asked.pipeline is None or is_named or (rig := rig_beside(asked.sources)) is None:
        return asked
    report_rig([rig])
    return replace(asked, overrides=(f"run.rig={json.dumps(str(rig.absolute()))}", *asked.overrides))


def _demand_seen_files(asked: FitRequest) -> None:
    """Raise ConfigurationError for what many curves on the workers of a scheduler cannot have."""
    for option, value in (("--by", asked.by), ("--stage", asked.stage)):
        if value:
            raise ConfigurationError(f"{option}: with --each, workers read each curve from a file that they can see")
    demand_no_jobs(asked.jobs)


def _curve_files(asked: FitRequest) -> CurveFiles:
    """Return the files that the pipeline reads; raises ConfigurationError."""
    if asked.pipeline is None:
        raise ConfigurationError("--each: say with --pipeline FILE how a curve is read")
    reading = load_pipeline(asked.pipeline, asked.overrides)
    device = log_device(reading, asked.pipeline)
    files = list(curve_files(asked.sources, type(reading.devices[device])))
    assignments = (*asked.overrides, f"device.{device}.file={json.dumps(str(files[0].file))}")
    pipeline = offline(load_pipeline(asked.pipeline, assignments))
    pipeline = replace(pipeline, run=pipeline.run.model_copy(update={"curves": None}))  # of another folder of fits
    return CurveFiles(files, pipeline, assignments, device)


def _fit_files(asked: FitRequest, curves: CurveFiles, stated: StatedFacts) -> Path:
    """Fit curves that are files by themselves, and return their folder of fits."""
    files = curves.files
    cells = file_facts(asked.sources, files, stated).listed(files, toml_tables(curves.pipeline.text))
    report_listed(map(stated_in, cells.values()), len(files))
    path = _folder(asked)
    folder = list_curves(path, [CurveGroup(curves.pipeline, curves.device, [*files])], cells)
    if asked.fitting:
        names = [curve.name for curve in files]
        fit_rows(folder, names, pool=_pool(asked, path), order=names)
    return path


def _folder(asked: FitRequest) -> Path:
    return asked.out or make_folder("fit", None, datetime.now(UTC).astimezone())


def _pool(asked: FitRequest, path: Path) -> Pool:
    """Return what fits curves: the workers of a scheduler, or processes of this machine."""
    if asked.scheduler is None:
        return partial(on_cores, workers=asked.jobs or core_count())
    from palpate_fits.curve_cluster import on_workers

    return partial(on_workers, asked.scheduler, path.resolve())


def _show(folder: FitFolder, asked: FitRequest) -> None:
    """Print the folder of fits; exit 1 where a fit failed."""
    tracks, pairs = folder.summary, setup_pairs(folder, folder.names, registry.load())
    if asked.as_json:
        document = {"table": str(folder.table), "tracks": tracks, "specimens": pairs_document(pairs)}
        typer.echo(json.dumps(document, indent=2))
    else:
        show_folder(folder, pairs, {}, asked.details)
        print_line(f"every number: {folder.table}")
    if failed := sum(track["failed"] for track in tracks.values()):
        typer.echo(f"{failed} fits of {sum(track['curves'] for track in tracks.values())} failed", err=True)
        raise typer.Exit(1)
