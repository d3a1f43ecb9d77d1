"""Weight and centre of mass of the load behind the sensor, read at standstill in several orientations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from palpate import Batch, Floats, LogError
from palpate_engine import GRAVITY, Ports
from palpate_kit.kinematics.rotations import rotation_matrix

from palpate_calibration.calibrated_value import MeasuredValue, RepeatValue
from palpate_calibration.sines import mean_with_std
from palpate_calibration.statics import WeightFit, weight_fit

_QUATERNION = ("qx", "qy", "qz", "qw")
_AXES = ("x", "y", "z", "tx", "ty", "tz")
# Choices.
_EDGE = 0.1  # [s] left out at both ends of a standstill
_MIN_STANDSTILL = 0.5  # [s]
_MIN_READINGS = 100  # of a standstill
_MAX_MISFIT = 5.0  # times the forces that noise and directions explain
_ANGLE_STEP = 1e-3  # [rad] for derivatives by a direction
_UNKNOWNS = 4  # of the forces: weight, and three of the bias
_SECOND = 1e9  # [ns]


class WrenchRecorder:
    """A recorder of batches: all six columns of the sensor that gives the force, and orientations of the tool."""

    def __init__(self, ports: Ports) -> None:
        """Find the sensor's six columns and the arm's orientation; raises LogError where a column is missing."""
        port = ports["force"]
        self.device, self._stream = port.key
        names = [channel.name for channel in port.stream.channels]
        missing = [axis for axis in _AXES if axis not in names]
        if missing:
            raise LogError(
                f"calibration: orientations need all six columns of the sensor; {', '.join(missing)} missing"
            )
        # The columns of force and torque, and the readings of each batch with their time-stamps [ns].
        self._columns = [names.index(axis) for axis in _AXES]
        self._sign = port.signal.sign
        self._stamps: list[NDArray[np.int64]] = []
        self._values: list[Floats] = []
        # The columns of the arm's quaternion, none where it reports no orientation.
        pose = ports["position"]
        self.arm, self._pose = pose.key
        channels = [channel.name for channel in pose.stream.channels]
        has_orientation = pose.stream.layout == "pose" and set(_QUATERNION) <= set(channels)
        self._orientation = [channels.index(name) for name in _QUATERNION] if has_orientation else []
        self._tool_stamps: list[NDArray[np.int64]] = []
        self._tools: list[Floats] = []

    @property
    def reads_orientation(self) -> bool:
        """True if the stream of the position is that of a pose."""
        return bool(self._orientation)

    def feed(self, device: str, batch: Batch) -> None:
        """Take in the readings of the sensor."""
        if (device, batch.stream) == (self.device, self._stream):
            rows = batch.valid
            self._stamps.append(batch.time[rows])
            self._values.append(self._sign * batch.values[rows][:, self._columns])
        if self._orientation and (device, batch.stream) == (self.arm, self._pose):
            rows = batch.valid
            self._tool_stamps.append(batch.time[rows])
            self._tools.append(batch.values[rows][:, self._orientation])

    def poses(self, stretches: Sequence[tuple[float, float]] | None = None, origin: int = 0) -> list[Pose]:
        """Return mean readings in stretches of time [s] since `origin` [ns], or in all; raises LogError."""
        if not self._stamps:
            raise LogError("calibration: the sensor gave no reading")
        stamps, values = np.concatenate(self._stamps), np.concatenate(self._values)
        time = (stamps - (origin if stretches else int(stamps[0]))) / _SECOND
        poses = []
        for begin, end in stretches or [(0.0, float(time[-1]))]:
            rows = (time >= begin + _EDGE) & (time < end - _EDGE)
            if end - begin < _MIN_STANDSTILL or rows.sum() < _MIN_READINGS:
                raise LogError(f"calibration: a standstill of {end - begin:.2f} s is too short to weigh the load")
            poses.append(replace(_pose(values[rows]), tool=self._tool((begin, end) if stretches else None, origin)))
        return poses

    def _tool(self, stretch: tuple[float, float] | None, origin: int) -> Floats | None:
        """Return the mean orientation (3, 3) of the tool in a stretch of time [s] since `origin` [ns], or in all."""
        if not self._tools:
            return None
        quaternions = np.concatenate(self._tools)
        if stretch is not None:
            time = (np.concatenate(self._tool_stamps) - origin) / _SECOND
            quaternions = quaternions[(time >= stretch[0] + _EDGE) & (time < stretch[1] - _EDGE)]
        if not len(quaternions):
            return None
        # The mean of q q^T has the mean orientation as its largest eigenvector, whatever the signs (Markley 2007).
        x, y, z, w = np.linalg.eigh(quaternions.T @ quaternions)[1][:, -1].tolist()
        return rotation_matrix((2.0 * math.atan2(math.hypot(x, y, z), w) * _unit(np.array([x, y, z]))).tolist())


@dataclass(frozen=True)
class Pose:
    """The sensor's mean readings in one orientation."""

    wrench: Floats  # (6,) [N, N m]
    std: Floats  # (6,) standard uncertainties
    tool: Floats | None = None  # (3, 3) orientation of the tool in the frame of the arm's poses; None: not recorded


def _pose(values: Floats) -> Pose:
    means = [mean_with_std(column) for column in values.T]
    return Pose(np.array([mean for mean, _, _ in means]), np.array([std for _, std, _ in means]))


def _unit(vector: Floats) -> Floats:
    length = float(np.linalg.norm(vector))
    return vector / length if length else vector


def tools_of(repeats: Sequence[Sequence[Pose]]) -> list[tuple[Floats, Floats, float]] | None:
    """Return mean forces (n, 3) [N], orientations (n, 3, 3) and noise [N] of each repeat; None without poses."""
    readings = []
    for poses in repeats:
        tools = [pose.tool for pose in poses if pose.tool is not None]
        if len(tools) < len(poses):
            return None
        noise = math.sqrt(float(np.mean([pose.std[:3] ** 2 for pose in poses])))
        readings.append((np.array([pose.wrench[:3] for pose in poses]), np.array(tools), noise))
    return readings


def weigh_tool(
    repeats: Sequence[Sequence[Pose]], down: Floats | Sequence[Sequence[float]], angle: float
) -> dict[str, MeasuredValue]:
    """Return mass, centre of mass and biases from all repeats, each with one pose for every direction of gravity.

    The directions are the same in every repeat (n, 3), or of each repeat (repeats, n, 3).

    Type B is what directions that are off by `angle` [rad] about each of two axes would do. Raises LogError where the
    readings do not follow the directions.
    """
    directions = np.broadcast_to(np.array(down, np.float64), (len(repeats), len(repeats[0]), 3))
    values_by_repeat, angle_terms = [], []
    for poses, downs in zip(repeats, directions, strict=True):
        # The standard uncertainties of a mean force and of a mean torque, as RMS over poses and axes.
        wrenches = np.array([pose.wrench for pose in poses])
        spread = np.sqrt(np.mean([pose.std**2 for pose in poses], axis=0))
        stds = float(np.sqrt((spread[:3] ** 2).mean())), float(np.sqrt((spread[3:] ** 2).mean()))
        fit = weight_fit(wrenches, downs, stds)
        _refuse_unfit(fit, wrenches, downs, stds[0], angle)
        values_by_repeat.append(dict(_numbers(fit)))  # by their names, such as mass and centre_x
        angle_terms.append(_angle_term(wrenches, downs, stds, angle))
    # The directions are the same in every repeat: their errors do not average out.
    type_b = np.sqrt(np.mean(np.square(angle_terms), axis=0))
    units = {"mass": "kg", "centre": "m", "bias": "N", "torque": "N*m"}  # by the first part of a name
    measured_values = {}
    for name, term in zip(values_by_repeat[0], type_b, strict=True):
        unit = units[name.partition("_")[0]]
        measured_values[name] = MeasuredValue.of([values[name] for values in values_by_repeat], unit, float(term))
    return measured_values


def _numbers(fit: WeightFit) -> list[tuple[str, RepeatValue]]:
    """Return all numbers of a fit by name."""
    numbers = [("mass_by_weight", fit.mass)]
    groups = (
        ("centre", fit.centre, fit.centre_std),
        ("bias", fit.force_bias, fit.force_bias_std),
        ("torque_bias", fit.torque_bias, fit.torque_bias_std),
    )
    for name, values, stds in groups:
        for axis, value, std in zip("xyz", values, stds, strict=True):
            numbers.append((f"{name}_{axis}", RepeatValue(float(value), float(std), fit.mass.freedom)))
    return numbers


def _angle_term(wrenches: Floats, downs: Floats, stds: tuple[float, float], angle: float) -> Floats:
    """Return the standard uncertainty (k,) of every number by that of the directions, each turned about two axes."""
    values = np.array([number.value for _, number in _numbers(weight_fit(wrenches, downs, stds))])
    variance = np.zeros_like(values)
    for i, down in enumerate(downs):
        helper = np.eye(3)[int(np.argmin(np.abs(down)))]
        first = np.cross(down, helper)
        first /= np.linalg.norm(first)
        for axis in (first, np.cross(down, first)):
            turned = downs.copy()
            turned[i] = math.cos(_ANGLE_STEP) * down + math.sin(_ANGLE_STEP) * np.cross(axis, down)
            turned_values = [number.value for _, number in _numbers(weight_fit(wrenches, turned, stds))]
            variance += ((np.array(turned_values) - values) / _ANGLE_STEP * angle) ** 2
    return np.asarray(np.sqrt(variance))


def _refuse_unfit(fit: WeightFit, wrenches: Floats, downs: Floats, std: float, angle: float) -> None:
    """Raise LogError where the forces are not those of a weight in these directions."""
    mass = fit.mass.value
    residual = wrenches[:, :3] - fit.force_bias - mass * GRAVITY * downs
    rms = math.sqrt(float((residual**2).sum()) / max(3 * len(downs) - _UNKNOWNS, 1))
    explained = math.hypot(std, abs(mass) * GRAVITY * angle)
    if mass <= 0 or rms > _MAX_MISFIT * explained:
        raise LogError(
            f"calibration: no weight explains the readings in these orientations: {mass * 1e3:.3g} g leave {rms:.3g} "
            f"N, and noise and directions explain {explained:.2g} N: was the tool turned as [calibration.orientations] "
            "down says, and is nothing touching it?"
        )
