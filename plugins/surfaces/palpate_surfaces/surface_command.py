"""``palpate calibrate surface``: where a mesh stands, by touches; the pose with its covariance, in a file."""

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
from palpate_surfaces.registration import FARTHEST, FEWEST, RegisteredPose, distances, register
from palpate_surfaces.registration_file import Registration, file_digest, read_registration
from palpate_surfaces.touches import Touches, digest_of, read_touches


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
    mesh = _mesh(pipeline, name)
    given = read_touches(touches, None if uncertainty is None else _length(uncertainty))
    sources = {digest_of(path): path for path in touches}
    count = len(given)
    if mesh.registration is not None:
        before = read_registration(mesh.registration, file_digest(mesh.file))
        if again := [str(path) for digest, path in sources.items() if digest in before.sources]:
            raise ConfigurationError(f"{mesh.registration} is made of {', '.join(again)} already; it counts once")
        count += before.touches
        sources = {**dict.fromkeys(before.sources, Path()), **sources}
    if count < FEWEST:
        raise ConfigurationError(f"these are {count} touches; {FEWEST} at least register a mesh")
    _refuse_contradictions(mesh, given)
    registered = register(mesh, given)
    _refuse_outliers(registered, given)
    document = _document(mesh, registered, count, tuple(sources))
    try:
        output.write_text(document.text(), encoding="utf-8")
    except OSError as error:
        raise OutputError(f"{output}: cannot write: {error.strerror}") from error
    if as_json:
        print_json({**document.model_dump(mode="json"), "probability": registered.probability, "file": str(output)})
    else:
        typer.echo("\n".join(_lines(mesh, registered, given, output)))


def _length(text: str) -> float:
    try:
        value = to_si(text, "m")
    except ValueError as error:
        raise ConfigurationError(f"--uncertainty: {error}") from error
    if value <= 0:
        raise ConfigurationError(f"--uncertainty: {text} is not above 0")
    return value


def _mesh(pipeline: Path, name: str | None) -> Mesh:
    found = {key: part for key, part in build_parts(Source.read(pipeline), "surface").items() if isinstance(part, Mesh)}
    if name is None and len(found) == 1:
        return next(iter(found.values()))
    names = ", ".join(found) or "none"
    if not found:
        raise ConfigurationError(f"{pipeline}: has no [surface.*] of type mesh; touches register a mesh")
    if name is None:
        raise ConfigurationError(f"{pipeline}: expected one mesh; choose by --surface (there are: {names})")
    if name not in found:
        raise ConfigurationError(f"--surface: {pipeline} has no mesh {name!r} (there are: {names})")
    return found[name]


def _refuse_contradictions(mesh: Mesh, touches: Touches) -> None:
    """Raise ConfigurationError for touches that are farther from the mesh than its pose allows."""
    distance, std = distances(mesh, touches)
    far = np.flatnonzero(np.abs(distance) > FARTHEST * std)
    if len(far):
        stated = mesh.registration or "its position and rotation"
        raise ConfigurationError(
            f"{len(far)} of {len(touches)} touches contradict where {mesh.file.name} stands by {stated}: "
            + _far_touches(touches, distance, distance / std, far)
            + ". Has the body moved, or is it another one? State its position again, with position_uncertainty"
        )


def _refuse_outliers(registered: RegisteredPose, touches: Touches) -> None:
    if registered.beyond:
        names = ", ".join(touches.name[row] for row in registered.beyond)
        raise ConfigurationError(f"beyond the rim of the mesh, where nothing is known of the body: {names}")
    far = np.flatnonzero(np.abs(registered.deviation) > FARTHEST)
    if len(far):
        raise ConfigurationError(
            f"{len(far)} of {len(touches)} touches do not fit the others: "
            + _far_touches(touches, registered.distance, registered.deviation, far)
            + ". Touch there again, or leave it out"
        )


def _far_touches(touches: Touches, distance: Floats, deviation: Floats, far: NDArray[np.int64]) -> str:
    worst = sorted(far.tolist(), key=lambda row: -abs(deviation[row]))[:5]
    return "; ".join(
        f"{touches.name[row]} is {1e3 * abs(distance[row]):.2f} mm {'above' if distance[row] > 0 else 'below'} it "
        f"({abs(deviation[row]):.1f} standard deviations)"
        for row in worst
    )


def _document(mesh: Mesh, registered: RegisteredPose, touches: int, sources: tuple[str, ...]) -> Registration:
    pose = registered.pose
    document: dict[str, Any] = {
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
    return Registration(**document)


def _lines(mesh: Mesh, registered: RegisteredPose, touches: Touches, output: Path) -> list[str]:
    pose = registered.pose
    std = np.sqrt(np.diag(pose.covariance))
    place = ", ".join(f"{1e3 * value:.2f} ± {1e3 * u:.2f}" for value, u in zip(pose.pivot, std[:3]))
    turn = ", ".join(f"{np.degrees(value):.2f}" for value in pose.rotation)
    turn_std = ", ".join(f"± {np.degrees(u):.2f}" for u in std[3:])
    lines = [
        f"{mesh.file.name}: {len(touches)} touches, {1e3 * registered.residual:.3f} mm from it (root mean square)",
        f"middle of the body  ({place}) mm",
        f"rotation vector     ({turn}) deg, about x, y, z {turn_std} deg",
    ]
    if registered.scale > 1:
        lines.append(
            f"the touches are farther from it than they are uncertain (p = {registered.probability:.2g}): every "
            f"uncertainty is {registered.scale**0.5:.1f} times as large for it"
        )
    lines += [f"left open by the touches: {direction}" for direction in registered.open]
    return [*lines, f'wrote {output}: registration = "{output}" in its table']
