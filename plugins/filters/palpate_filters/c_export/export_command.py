"""``palpate model export``: an estimator of a pipeline as C99, for a controller or a microcontroller."""

from __future__ import annotations

import shutil
import subprocess
from collections import Counter
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer
from palpate import ConfigurationError, Problem, suggest
from palpate_engine import Pipeline, Track, build_pipeline, load_pipeline, make_folder, write_new
from palpate_kit.kernel import step_function
from palpate_kit.kernel.translation import Untranslatable, operations
from palpate_kit.runs.replay_source import read_run_log, replay_source
from palpate_kit.terminal.options import Overrides

from palpate_filters.c_export.c_program import header, part, share, source
from palpate_filters.c_export.c_source import CHEAP, c_number
from palpate_filters.c_export.exported_track import ExportedTrack, export_track
from palpate_filters.c_export.test_vectors import Vectors, added_weight, make_vectors
from palpate_filters.starting_fit import PAUSE


def export_filter(
    file: Annotated[
        Path, typer.Argument(help="A pipeline file without live devices, a run folder, or a log of a run.")
    ],
    track: Annotated[str, typer.Option(help='The track, such as "dr/kinematic-ekf".')],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder; must be new or empty.")],
    overrides: Overrides = None,
) -> None:
    """Write an estimator as C99 that needs libm alone, with tare, touch and start; check it against palpate's numbers.

    The pipeline is run once, for the test vectors. Where a C compiler is found, the check is compiled and run.
    """
    pipeline = _pipeline(file, overrides or [])
    chosen = _track(pipeline, track)
    live = [name for name, device in pipeline.devices.items() if device.live]
    if live:
        raise ConfigurationError(
            f"{file}: [device.{live[0]}] is live, and test vectors come from a record: give the run folder of a run"
        )
    filter = export_track(track, chosen.estimator, _problem(pipeline, chosen))
    _refuse_alignment(pipeline, track)
    vectors = make_vectors(pipeline, chosen)
    folder = make_folder("filter", out, datetime.now(UTC).astimezone())
    _write_files(folder, filter, pipeline, vectors, file, track)
    typer.echo(f"written to {folder}: {len(vectors.samples)} samples at {vectors.rate:.0f} Hz to check it with")
    _check(folder)


def _pipeline(file: Path, overrides: list[str]) -> Pipeline:
    """Return the pipeline of a file, or that of a run that its folder or log holds."""
    if not file.is_dir() and file.suffix == ".toml":
        return load_pipeline(file, overrides)
    run_log = read_run_log(file)
    if run_log is None:
        raise ConfigurationError(f"{file}: is not a pipeline file, a run folder or a log of a run")
    source = replay_source(run_log)
    for assignment in overrides:
        source.override(assignment)
    return build_pipeline(source)


def _track(pipeline: Pipeline, name: str) -> Track:
    for track in pipeline.tracks:
        if track.name == name:
            return track
    hint = suggest(name, [str(track.name) for track in pipeline.tracks])
    raise ConfigurationError(f"{pipeline.path}: has no track {name!r}{hint}")


def _problem(pipeline: Pipeline, track: Track) -> Problem:
    others = {name: tuple(p.name for p in model.parameters) for name, model in pipeline.models.items()}
    still = pipeline.safety.standstill if pipeline.safety else None
    return Problem(
        model=track.model,
        tip_mass=pipeline.alignment.tip_mass,
        timing_uncertainty=pipeline.alignment.timing_uncertainty,
        standstill=still,
        others=others,
    )


def _refuse_alignment(pipeline: Pipeline, track: str) -> None:
    """Raise ConfigurationError for an alignment that exported C does not have."""
    if pipeline.alignment.is_oriented:
        stated = pipeline.alignment.model_fields_set
        key = next(name for name in ("normal", "surface", "weight") if name in stated)
        raise ConfigurationError(
            f"track {track}: [alignment] {key} reads the tool's orientation, and exported C takes one force: without it"
        )
    if pipeline.alignment.tare == "calibrated":
        raise ConfigurationError(
            f'track {track}: tare = "calibrated" cannot be exported: set [alignment] tare to the force itself'
        )


def _write_files(
    folder: Path, filter: ExportedTrack, pipeline: Pipeline, vectors: Vectors, file: Path, track: str
) -> None:
    """Write all files of the folder of a filter in C; `file` is that of the pipeline which has its track.

    `vectors` are the samples and estimates that the compiled filter is checked with.
    Raises ConfigurationError where C has no counterpart of an instruction.
    """
    settings = pipeline.alignment
    title = f"{track} of {file.name}"
    # Numbers of the C code that its user may change. A tare or a touch that is measured has no number here, so 0; no
    # standstill is -1.
    defaults = [
        f"tare_measured = {int(settings.tare == 'free-air')}",
        f"tare_offset = {c_number(settings.tare if isinstance(settings.tare, float) else 0.0)}",
        f"tare_duration = {c_number(settings.tare_duration)}",
        f"touch_lag = {c_number(settings.touch_lag)}",
        f"touch_force = {c_number(settings.touch_force if isinstance(settings.touch_force, float) else 0.0)}",
        f"drift = {c_number(settings.drift)}",
        f"weight = {c_number(added_weight(pipeline))}",
        f"standstill = {c_number(-1.0 if filter.standstill is None else filter.standstill)}",
        f"window = {c_number(filter.window)}",
        f"share = {share(vectors.rate)}",
    ]
    try:
        code = source(filter, defaults)
    except Untranslatable as error:
        raise ConfigurationError(f"track {track}: cannot be exported: {error}") from error
    texts = {
        "palpate_filter.h": header(filter, title, vectors.rate, settings.tare_duration, settings.touch_lag),
        "palpate_filter.c": code,
        "check.c": part("check.c"),
        "Makefile": part("Makefile"),
        "README.md": readme(filter, title, vectors.rate, settings.tare_duration, PAUSE),
    }
    for name, text in texts.items():
        write_new(folder / name, text)
    # Inputs and outputs that the compiled filter is checked with.
    vectors.write(folder / "vectors.csv", [parameter.name for parameter in filter.model.parameters])


def _check(folder: Path) -> None:
    """Compile and run the check where there is a compiler; raises ConfigurationError where it fails."""
    compiler, make = shutil.which("cc"), shutil.which("make")
    if compiler is None or make is None:
        typer.echo("not compiled: no C compiler or no make found here; do it with `make check`", err=True)
        return
    done = subprocess.run([make, "-C", str(folder), "-s", "check", "size"], capture_output=True, text=True)
    typer.echo(done.stdout.rstrip())
    if done.returncode != 0:
        raise RuntimeError(f"the exported filter does not pass its check in {folder}: {done.stderr or done.stdout}")


def readme(filter: ExportedTrack, title: str, rate: float, tare_duration: float, pause: float) -> str:
    """Return the text: the filter, its calls, its cost, its check."""
    step = step_function(filter.recursion.step)
    names = operations()
    # Instructions by kind; constants, inputs and outputs cost nothing, and what remains are functions of libm.
    counts = Counter(names[step.instruction_id(k)] for k in range(step.n_instructions()))
    divisions = counts["OP_DIV"] + counts["OP_INV"]
    cheap = sum(count for name, count in counts.items() if name in CHEAP) - divisions
    inert = sum(counts[name] for name in ("OP_CONST", "OP_INPUT", "OP_OUTPUT"))
    return part("README.md").format(
        title=title,
        parameters=", ".join(f"{p.name} [{p.unit}]" for p in filter.model.parameters),
        rate=rate,
        first=filter.model.parameters[0].name.upper(),
        tare=tare_duration,
        pause=1e3 * pause,
        mass=filter.mass,
        cheap=cheap,
        divisions=divisions,
        functions=step.n_instructions() - cheap - divisions - inert,
        opening=part("opening.md").format(window=filter.window) if filter.window > 0 else "",
    )
