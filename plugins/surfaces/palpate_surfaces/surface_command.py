"""``palpate calibrate surface``: the pose of a mesh by touches, with its covariance, in a file."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray
from palpate import ConfigurationError, Floats, OutputError, to_si
from palpate_engine import Source, build_parts
from palpate_kit.terminal.json_output import print_json
from palpate_kit.terminal.options import JsonOption

from palpate_surfaces.mesh import Mesh
from palpate_surfaces.registration import MAX_DEVIATION, MIN_TOUCHES, RegisteredPose, distances, register
from palpate_surfaces.registration_file import Registration, file_digest, read_registration
from palpate_surfaces.touches import Touches, read_touches, touches_digest

_LISTED_TOUCHES = 5  # in a message, the worst: a choice


def surface(
    pipeline: Annotated[Path, typer.Argument(help="Pipeline file with the [surface.*] table of a mesh.")],
    touches: Annotated[
        list[Path], typer.Argument(help="Runs that touched it, and tables: x [mm],y [mm],z [mm],u [mm].")
    ],
    name: Annotated[str | None, typer.Option("--surface", help="Its NAME in [surface.NAME], of several.")] = None,
    uncertainty: Annotated[
        str | None, typer.Option(help="Standard uncertainty of the touches in tables that do not state it.")
    ] = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="File to write.")] = Path("registration.toml"),
    as_json: JsonOption = False,
) -> None:
    """Register a mesh by touches: the pose that fits them, with its covariance, for `registration` of its table.

    The pose that the table states, with its uncertainty, is where the search begins, and what the touches leave open
    stays so. Touches that contradict it, or one another, by more than 3 standard deviations are named, and nothing is
    written.
    """
    mesh = _choose_mesh(pipeline, name)
    measured_touches = read_touches(touches, None if uncertainty is None else _parse_uncertainty(uncertainty))
    count, sources = _count_touches(mesh, touches, len(measured_touches))
    if count < MIN_TOUCHES:
        raise ConfigurationError(f"these are {count} touches; {MIN_TOUCHES} at least register a mesh")
    _refuse_contradictions(mesh, measured_touches)
    registered = register(mesh, measured_touches)
    _refuse_outliers(registered, measured_touches)
    registration = _registration(mesh, registered, count, sources)
    try:
        output.write_text(registration.text(), encoding="utf-8")
    except OSError as error:
        raise OutputError(f"{output}: cannot write: {error.strerror}") from error
    if as_json:
        numbers = registration.model_dump(mode="json")
        print_json({**numbers, "probability": registered.probability, "file": str(output)})
    else:
        typer.echo("\n".join(_summary_lines(mesh, registered, measured_touches, output)))


def _parse_uncertainty(text: str) -> float:
    """Return the length [m] of `--uncertainty`, above 0; raises ConfigurationError."""
    try:
        length = to_si(text, "m")
    except ValueError as error:
        raise ConfigurationError(f"--uncertainty: {error}") from error
    if length <= 0:
        raise ConfigurationError(f"--uncertainty: {text} is not above 0")
    return length


def _choose_mesh(pipeline: Path, name: str | None) -> Mesh:
    """Return the mesh of a name in a pipeline's file, or its only one; raises ConfigurationError."""
    surfaces = build_parts(Source.read(pipeline), "surface")
    meshes = {key: part for key, part in surfaces.items() if isinstance(part, Mesh)}
    if name is None and len(meshes) == 1:
        return next(iter(meshes.values()))
    names = ", ".join(meshes) or "none"
    if not meshes:
        raise ConfigurationError(f"{pipeline}: has no [surface.*] of type mesh; touches register a mesh")
    if name is None:
        raise ConfigurationError(f"{pipeline}: expected one mesh; choose by --surface (there are: {names})")
    if name not in meshes:
        raise ConfigurationError(f"--surface: {pipeline} has no mesh {name!r} (there are: {names})")
    return meshes[name]


def _count_touches(mesh: Mesh, paths: list[Path], new_touches: int) -> tuple[int, tuple[str, ...]]:
    """Return the number of touches with those of a former registration, and the digests of all their sources.

    Raises ConfigurationError for a source that the former registration has already.
    """
    path_of_digest = {touches_digest(path): path for path in paths}
    if mesh.registration is None:
        return new_touches, tuple(path_of_digest)
    former = read_registration(mesh.registration, file_digest(mesh.file))
    repeated = [str(path) for digest, path in path_of_digest.items() if digest in former.sources]
    if repeated:
        raise ConfigurationError(f"{mesh.registration} is made of {', '.join(repeated)} already; it counts once")
    return new_touches + former.touches, tuple(dict.fromkeys([*former.sources, *path_of_digest]))


def _refuse_contradictions(mesh: Mesh, touches: Touches) -> None:
    """Raise ConfigurationError for touches that are farther from the mesh than its pose allows."""
    distance, std = distances(mesh, touches)
    far_rows = np.flatnonzero(np.abs(distance) > MAX_DEVIATION * std)
    if len(far_rows):
        stated = mesh.registration or "its position and rotation"
        raise ConfigurationError(
            f"{len(far_rows)} of {len(touches)} touches contradict where {mesh.file.name} stands by {stated}: "
            + _far_touches_text(touches, distance, distance / std, far_rows)
            + ". Has the body moved, or is it another one? State its position again, with position_uncertainty"
        )


def _refuse_outliers(registered: RegisteredPose, touches: Touches) -> None:
    """Raise ConfigurationError for touches beyond the mesh's rim, and for those that do not fit the others."""
    if registered.beyond:
        names = ", ".join(touches.name[row] for row in registered.beyond)
        raise ConfigurationError(f"beyond the rim of the mesh, where nothing is known of the body: {names}")
    far_rows = np.flatnonzero(np.abs(registered.deviation) > MAX_DEVIATION)
    if len(far_rows):
        raise ConfigurationError(
            f"{len(far_rows)} of {len(touches)} touches do not fit the others: "
            + _far_touches_text(touches, registered.distance, registered.deviation, far_rows)
            + ". Touch there again, or leave it out"
        )


def _far_touches_text(touches: Touches, distance: Floats, deviation: Floats, far_rows: NDArray[np.int64]) -> str:
    """Return the worst of the touches in some rows, with distance [m] (n,) and deviation [standard deviations] (n,)."""
    worst_rows = sorted(far_rows.tolist(), key=lambda row: -abs(deviation[row]))[:_LISTED_TOUCHES]
    return "; ".join(
        f"{touches.name[row]} is {1e3 * abs(distance[row]):.2f} mm {'above' if distance[row] > 0 else 'below'} it "
        f"({abs(deviation[row]):.1f} standard deviations)"
        for row in worst_rows
    )


def _registration(mesh: Mesh, registered: RegisteredPose, touches: int, sources: tuple[str, ...]) -> Registration:
    """Return the registration for the file, of so many touches from sources (digests)."""
    pose = registered.pose
    numbers: dict[str, Any] = {
        "created": datetime.now(UTC),
        "mesh": file_digest(mesh.file),
        "touches": touches,
        "sources": sources,
        "rotation": tuple(pose.rotation.tolist()),
        "position": tuple(pose.translation.tolist()),
        "pivot": tuple(pose.pivot.tolist()),
        "covariance": tuple(tuple(row) for row in pose.covariance.tolist()),
        "residual": registered.residual,
        "open": registered.open,
    }
    return Registration(**numbers)


def _summary_lines(mesh: Mesh, registered: RegisteredPose, touches: Touches, output: Path) -> list[str]:
    """Return the pose, its uncertainty and its open directions for a person."""
    pose = registered.pose
    std = np.sqrt(np.diag(pose.covariance))
    position = ", ".join(f"{1e3 * x:.2f} ± {1e3 * u:.2f}" for x, u in zip(pose.pivot, std[:3]))
    rotation = ", ".join(f"{np.degrees(angle):.2f}" for angle in pose.rotation)
    rotation_std = ", ".join(f"± {np.degrees(u):.2f}" for u in std[3:])
    lines = [
        f"{mesh.file.name}: {len(touches)} touches, {1e3 * registered.residual:.3f} mm from it (root mean square)",
        f"middle of the body  ({position}) mm",
        f"rotation vector     ({rotation}) deg, about x, y, z {rotation_std} deg",
    ]
    if registered.scale > 1:
        lines.append(
            f"the touches are farther from it than they are uncertain (p = {registered.probability:.2g}): every "
            f"uncertainty is {registered.scale**0.5:.1f} times as large for it"
        )
    lines += [f"left open by the touches: {direction}" for direction in registered.open]
    return [*lines, f'wrote {output}: registration = "{output}" in its table']
