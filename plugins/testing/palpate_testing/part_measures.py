"""Measures of a part of each kind, by its check in simulation."""

from __future__ import annotations

import inspect
import json
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from palpate import (
    ConfigurationError,
    ContactModel,
    Device,
    Estimator,
    Indenter,
    Surface,
    Trajectory,
    Twin,
    contact_force,
    surface_points,
)
from palpate_engine import Source, build_parts, registry as registries

from palpate_testing.device_checks import check_device, moves
from palpate_testing.estimator_checks import check_estimator
from palpate_testing.model_checks import check_model, usual_values
from palpate_testing.surface_checks import check_surface
from palpate_testing.tip_checks import check_indenter
from palpate_testing.trajectory_checks import check_trajectory
from palpate_testing.truth_checks import NOISY, NOISY_RECORDS, QUIET, QUIET_RECORDS
from palpate_testing.truth_records import Errors, estimate_records

CHECKED_KINDS = ("indenter", "model", "estimator", "trajectory", "surface", "device")
DEPTHS = (1e-3, 3e-3, 6e-3)  # [m], from a shallow palpation to a deep one (a choice)
FAST = 0.01  # [m/s], the rate of a palpation
THETA = (1e5, 300.0)  # [Pa], [Pa s] of the paper's silicone
COVERAGE_FACTOR = 2.0  # standard uncertainties within which errors are counted
STEP = 1e-3  # [s] of the grid of a motion (a choice)
PLACES = np.array([(0.0, 0.0), (2e-3, 0.0), (0.0, 2e-3)])  # [m] x and y, at which a surface is looked at
LISTEN = 3.0  # [s] to a live device (a choice)
# What the twin of an arm presses on: the paper's silicone under a sphere of 5 mm.
SPECIMEN = """{model = {type = "dimensionality-reduction", indenter = {type = "sphere", radius = "5 mm"}}, \
elasticity = "100 kPa", viscosity = "300 Pa*s"}"""


@dataclass(frozen=True)
class Measures:
    """Check of a part, and what it measured."""

    check: str  # name of the check
    tried: str  # sentence on what it tries
    rows: tuple[tuple[str, str], ...]  # names and values of what was measured, as texts


def _measures(check: Callable[..., None], rows: Iterator[tuple[str, str]]) -> Measures:
    """Return measures with the sentence of the check's docstring on what it tries."""
    text = " ".join((inspect.getdoc(check) or "").split())
    tried = text.partition("Checked")[2].partition("Raises AssertionError")[0].lstrip(": ").strip()
    return Measures(check.__name__, tried, tuple(rows))


def measure_tip(tip: Indenter) -> Measures:
    """Check a tip, and measure contact radius and area over the depth."""
    check_indenter(tip)

    def rows() -> Iterator[tuple[str, str]]:
        """Yield names and values."""
        for depth in DEPTHS:
            radius, area = float(tip.contact_radius(depth)), float(tip.profile_area(depth))
            yield f"contact radius and area at {1e3 * depth:g} mm", f"{1e3 * radius:.4g} mm, {1e6 * area:.4g} mm^2"

    return _measures(check_indenter, rows())


def measure_model(model: ContactModel) -> Measures:
    """Check a contact model at usual values of its parameters, and measure its force over the depth."""
    theta = usual_values(model)
    check_model(model, theta)

    def rows() -> Iterator[tuple[str, str]]:
        """Yield names and values."""
        for parameter, number in zip(model.parameters, theta, strict=True):
            yield f"{parameter.name} ({parameter.role or 'no role'})", f"{number:.4g} {parameter.unit}"
        empty = (0.0,) * len(model.memory)
        for depth in DEPTHS:
            forces = [float(contact_force(model, depth, rate, theta, empty)) for rate in (0.0, FAST)]
            yield f"force at {1e3 * depth:g} mm, at rest and at 10 mm/s", f"{forces[0]:.4g} N, {forces[1]:.4g} N"

    return _measures(check_model, rows())


def measure_estimator(estimator: Estimator) -> Measures:
    """Check an estimator on records of known truth, of the model of the paper under a sphere of 5 mm."""
    model = standard_model()
    check_estimator(estimator, model, THETA, truth=True)

    def rows() -> Iterator[tuple[str, str]]:
        """Yield names and values."""
        for motion, count, noise in ((QUIET, QUIET_RECORDS, "almost without noise"), (NOISY, NOISY_RECORDS, "noisy")):
            errors = estimate_records(estimator, model, THETA, motion, count)
            for index, parameter in enumerate(model.parameters):
                name = f"{parameter.name}, {count} records of {motion.duration:g} s, {noise}"
                # The bound is that of the sensors' noise.
                yield name, _describe_errors(errors, index, with_bound=motion is NOISY)

    return _measures(check_estimator, rows())


def _describe_errors(errors: Errors, index: int, with_bound: bool) -> str:
    """Return bias and scatter of a parameter as a text; with a bound also its coverage, and std over the bound."""
    if not np.isfinite(errors.values[:, index]).any():
        return "no number on records that begin in contact"
    bias, scatter = np.nanmean(errors.relative[:, index]), np.nanstd(errors.relative[:, index])
    text = f"bias {bias:+.2%}, scatter {scatter:.2%}"
    if with_bound:
        ratio = np.nanmedian(errors.std[:, index] / errors.bound[:, index])
        coverage = np.nanmean(np.abs(errors.standardized[:, index]) <= COVERAGE_FACTOR)
        text += f", {coverage:.0%} within 2 u; u is {ratio:.3g} times the bound with a known surface"
    return text


def measure_trajectory(trajectory: Trajectory) -> Measures:
    """Check a motion, and measure its duration, depth and speed."""
    check_trajectory(trajectory)

    def rows() -> Iterator[tuple[str, str]]:
        """Yield names and values."""
        time = np.arange(0.0, trajectory.total_duration + STEP, STEP)
        setpoint = trajectory.at(time)
        yield "duration", f"{trajectory.total_duration:.4g} s"
        height = setpoint.position[:, 2]
        heights = f"{1e3 * float(height.min()):.4g} mm and {1e3 * float(height.max()):.4g} mm"
        yield "deepest and highest setpoint", heights
        yield "largest speed", f"{1e3 * float(np.linalg.norm(setpoint.velocity, axis=1).max()):.4g} mm/s"
        acceleration = np.linalg.norm(np.gradient(setpoint.velocity, STEP, axis=0), axis=1)
        yield "largest acceleration", f"{float(acceleration.max()):.4g} m/s^2"

    return _measures(check_trajectory, rows())


def measure_surface(surface: Surface) -> Measures:
    """Check a surface around the origin of x and y, and measure its height and slope there."""
    check_surface(surface, PLACES)

    def rows() -> Iterator[tuple[str, str]]:
        """Yield names and values."""
        points = surface_points(surface, PLACES)
        for xy, height, normal in zip(PLACES, points.position[:, 2], points.normal, strict=True):
            slope = math.degrees(math.acos(min(float(normal[2]), 1.0)))
            x, y = (1e3 * xy).tolist()  # [mm]
            yield f"height and slope at ({x:g}, {y:g}) mm", f"{1e3 * float(height):.4g} mm, {slope:.3g} deg"

    return _measures(check_surface, rows())


def measure_device(device: Device) -> Measures:
    """Check a device in simulation: one that talks to hardware against the twin that stands in for it.

    Raises ConfigurationError where no twin does.
    """
    if device.live:
        twin = _twin_of(device)
        if twin is None:
            name = type(device).__name__
            raise ConfigurationError(f"{name} talks to hardware, and no twin stands in for it: check it in a test")
        with twin.simulated(seed=0):
            check_device(device, short_motion() if moves(device, 0) else None, listen=LISTEN)
    else:
        check_device(device, short_motion() if moves(device, 0) else None)

    def rows() -> Iterator[tuple[str, str]]:
        """Yield names and values."""
        for stream in device.streams:
            rate = "by its time-stamps" if stream.rate is None else f"{stream.rate:g} Hz"
            channels = ", ".join(f"{channel.name} [{channel.unit}]" for channel in stream.channels)
            yield f"stream {stream.name or 'without a name'}", f"{rate}: {channels}"

    return _measures(check_device, rows())


def _twin_of(device: Device) -> Twin | None:
    """Return the twin that stands in for a device alone; None where none does."""
    registry = registries.load()
    for type_name, entry in registry.parts["twin"].items():
        twin: Any = entry.part if entry.problem is None else None
        settings = twin.stand_in({"part": device}, None) if twin is not None else None
        if settings is None:
            continue
        table = f"[twin.part]\ntype = {json.dumps(type_name)}\nspecimen = {SPECIMEN}\n"
        source = Source(table, Path("palpate check part"))
        for key, text in settings.items():
            source.override(f"twin.part.{key}={text}")
        part: Any = build_parts(source, "twin", registry)["part"]
        assert isinstance(part, Twin)
        return part
    return None


def short_motion() -> Any:
    """Return half a second of the paper's motion, 3 mm deep; raises PluginError where no plugin offers it."""
    motion: Any = registries.load().find("trajectory", "point")
    return motion(bias=3e-3, amplitude=1e-3, duration=0.5)


def standard_model() -> Any:
    """Return the paper's model under a sphere of 5 mm; raises PluginError where no plugin offers it."""
    registry = registries.load()
    tip: Any = registry.find("indenter", "sphere")
    model: Any = registry.find("model", "dimensionality-reduction")
    return model(indenter=tip(radius=5e-3))
