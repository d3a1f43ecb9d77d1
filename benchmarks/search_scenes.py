"""Scenes of a search: lumps in a rough silicone or below a curved skin, rigs that palpate them, seconds of motion."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from palpate import Floats, Surface, Trajectory, surface_of
from palpate_engine.config import Pipeline, load_pipeline
from palpate_maps.map_analysis import Path2D, Sites, sites_along
from palpate_maps.path_reader import join_paths
from palpate_simulation.skin_under_tip import SkinUnderTip
from palpate_surfaces import HalfEllipsoid
from sweeps import paths

RASTER = Path(__file__).parent.parent / "pipelines" / "raster.toml"
BODY = Path(__file__).parent.parent / "pipelines" / "breast.toml"
HALF_AXES = (0.06, 0.05, 0.04)  # [m] of the body
HOLLOW = (0.08, 0.06)  # [m] radii of curvature of the bowl
SKINS = ("half ellipsoid", "dome of triangles", "bowl of triangles", "touched")
BOX = (-0.03, 0.03, -0.02, 0.02)  # [m] that is searched
TRAVEL = 0.05  # [m/s] from the end of one part to the beginning of the next
SPEED = 6.0  # [mm/s] along lines


@dataclass(frozen=True)
class Scene:
    """What a specimen hides, and its rig."""

    seed: int
    middles: list[tuple[float, float]]  # [m]
    peaks: list[float]  # contrasts
    settings: list[str]
    drift: float  # of the tare [N/s]

    @functools.cached_property
    def pipeline(self) -> Pipeline:
        """The raster over the scene."""
        return replace(load_pipeline(self.file, self.settings), sinks={})

    @property
    def file(self) -> Path:
        """The pipeline that the settings change."""
        return RASTER

    @property
    def motion(self) -> Any:
        """The motion of the pipeline along lines."""
        (motion,) = self.pipeline.trajectories.values()
        return motion

    def tips(self, places: Floats) -> Floats:
        """Where (n, 3) [m] the tip is that just touches the skin at places (n, 2) [m]."""
        return np.pad(places, ((0, 0), (0, 1)))

    def contrast(self, places: Floats) -> Floats:
        """The true contrast (n,) over the specimen's own stiffness that the tip feels at places (n, 2) [m]."""
        specimen = self.pipeline.devices["rig"].specimen  # type: ignore[attr-defined]
        plain = specimen.model_copy(update={"inclusions": ()})
        tips = self.tips(places)
        return SkinUnderTip(specimen, tips).theta[0] / SkinUnderTip(plain, tips).theta[0] - 1


def scene(seed: int, count: int, peaks: tuple[float, float], body: str) -> Scene:
    """Spheres 20 mm or more apart anywhere in the box, with contrasts up to a factor between them, on a rough skin."""
    dice = np.random.default_rng(seed)
    middles, heights, bodies = _hidden(dice, count, peaks, body)
    rough, tilt, drift = dice.uniform(0.02, 0.1), dice.uniform(-0.5, 0.5, 2), dice.uniform(-5, 5) / 3600
    relief = f'{{roughness="{rough} mm", length="10 mm", tilt_x="{tilt[0]} deg", tilt_y="{tilt[1]} deg", seed={seed}}}'
    settings = [
        f"run.seed={seed}",
        'run.tracks=["dr/smoother"]',
        f"device.rig.specimen.relief={relief}",
        f'device.rig.specimen.scatter={{std=0.005, length="20 mm", seed={seed}}}',
        f"device.rig.specimen.inclusions=[{bodies}]",
        f"device.rig.drift={drift} N/s",
        "device.rig.sensor_rate=500 Hz",
        f"trajectory.raster.speed={SPEED} mm/s",
        f"estimator.smoother.sweep_speed={SPEED} mm/s",
        "trajectory.raster.settle=1 s",
    ]
    return Scene(seed, middles, heights, settings, drift)


def _hidden(
    dice: np.random.Generator, count: int, peaks: tuple[float, float], body: str
) -> tuple[list[tuple[float, float]], list[float], str]:
    """Middles [m] of spheres, the contrasts of each, and both as a pipeline states them."""
    middles: list[tuple[float, float]] = []
    while len(middles) < count:
        new = tuple(dice.uniform((BOX[0], BOX[2]), (BOX[1], BOX[3])).tolist())
        if all(math.dist(new, old) >= 0.02 for old in middles):
            middles.append(new)
    heights = [float(np.exp(dice.uniform(*np.log(peaks)))) for _ in middles]
    bodies = ",".join(
        f'{{shape="sphere", place=["{1e3 * x} mm","{1e3 * y} mm"], {body}, peak={peak}}}'
        for (x, y), peak in zip(middles, heights, strict=True)
    )
    return middles, heights, bodies


@dataclass(frozen=True)
class SkinScene(Scene):
    """A body with a curved skin."""

    @property
    def file(self) -> Path:
        """The pipeline that the settings change."""
        return BODY

    def tips(self, places: Floats) -> Floats:
        """Where (n, 3) [m] the tip is, a sphere over its centre, that just touches the skin at places (n, 2) [m]."""
        surface: Surface | None = surface_of(self.motion)
        assert surface is not None
        points, specimen = surface.uppermost(places), self.pipeline.devices["rig"].specimen  # type: ignore[attr-defined]
        return np.asarray(points.position + specimen.tip_radius * (points.normal - [0.0, 0.0, 1.0]))


def skin_scene(kind: str, seed: int, count: int, peaks: tuple[float, float], folder: Path) -> SkinScene:
    """Spheres 20 mm or more apart anywhere in the box, below one of SKINS; its files are written into a folder."""
    dice = np.random.default_rng(seed)
    middles, heights, bodies = _hidden(dice, count, peaks, LEAST)
    drift = dice.uniform(-5, 5) / 3600
    pitch, width = 1e3 * (BOX[3] - BOX[2]) / 2, 1e3 * (BOX[1] - BOX[0])
    press = '{bias="4 mm", amplitude="1 mm", frequency="3 Hz"}'
    settings = [
        f"run.seed={seed}",
        f"surface.breast={_skin(kind, folder)}",
        f"device.rig.specimen.inclusions=[{bodies}]",
        f"device.rig.drift={drift} N/s",
        f'trajectory.points={{type="raster", surface="breast", size=["{width} mm", "{2 * pitch} mm"], '
        f'pitch="{pitch} mm", speed="{SPEED} mm/s", settle="1 s", press={press}}}',
    ]
    return SkinScene(seed, middles, heights, settings, drift)


def _skin(kind: str, folder: Path) -> str:
    """The table of a surface; the file of one of triangles, or of touches, is written into a folder."""
    file = folder / f"{kind.replace(' ', '-')}.{'csv' if kind == 'touched' else 'obj'}"
    axes = ", ".join(f'"{1e3 * axis} mm"' for axis in HALF_AXES)
    if kind == "half ellipsoid":
        return f'{{type="half-ellipsoid", half_axes=[{axes}]}}'
    x, y = (1e-3 * axis.ravel() for axis in np.meshgrid(np.arange(-44.0, 45.0), np.arange(-36.0, 37.0)))
    body = HalfEllipsoid(half_axes=HALF_AXES)
    if kind == "touched":
        places = np.column_stack([x, y])[(np.hypot(x / 0.046, y / 0.038) < 1) & (np.hypot(x % 0.006, y % 0.006) < 1e-6)]
        rows = [",".join(f"{1e3 * at:.4f}" for at in place) + ",0.1" for place in body.uppermost(places).position]
        file.write_text("\n".join(["x [mm],y [mm],z [mm],u [mm]", *rows]) + "\n")
        return f'{{type="touched", touches=["{file}"]}}'
    hollow = x**2 / (2 * HOLLOW[0]) + y**2 / (2 * HOLLOW[1])
    z = hollow if kind.startswith("bowl") else body.uppermost(np.column_stack([x, y])).position[:, 2]
    _write_sheet(file, x, y, z)
    return f'{{type="mesh", file="{file}", position_uncertainty="0.3 mm", rotation_uncertainty="1 deg"}}'


def _write_sheet(file: Path, x: Floats, y: Floats, z: Floats) -> None:
    """Write heights (n,) [m] over a whole grid in x and y as triangles, with a hole where the height is unknown."""
    columns = len(np.unique(x))
    corner = np.where(np.isfinite(z), np.cumsum(np.isfinite(z)), 0).reshape(-1, columns)
    a, b, c, d = (part.ravel() for part in (corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]))
    whole = np.minimum(np.minimum(a, b), np.minimum(c, d)) > 0
    faces = np.vstack([np.column_stack([a, b, c])[whole], np.column_stack([a, c, d])[whole]])
    rows = [f"v {1e3 * p:.6f} {1e3 * q:.6f} {1e3 * r:.6f}" for p, q, r in zip(x, y, z, strict=True) if np.isfinite(r)]
    file.write_text("\n".join([*rows, *(f"f {i} {j} {k}" for i, j, k in faces.tolist())]) + "\n")


@dataclass
class Rig:
    """The rig of a scene, and what it has got so far: with the simulated rig, its relief, and the smoother."""

    scene: Scene
    seconds: float = 0.0  # of motion
    palpations: int = 0  # points and lines
    found: list[Path2D] = field(default_factory=list)
    tip: Floats | None = None

    def palpate(self, motion: Any) -> Sites:
        """Make a motion; all sites so far."""
        ends = motion.at(np.array([0.0, motion.total_duration])).position[:, :2]
        if self.tip is not None:
            self.seconds += float(np.hypot(*(ends[0] - self.tip))) / TRAVEL
        self.tip = ends[1]
        self.seconds += motion.total_duration
        self.palpations += len(getattr(motion, "visits", [0])) if not hasattr(motion, "lines") else motion.lines
        return self.sites_of(motion)

    def sites_of(self, motion: Any) -> Sites:
        """All sites so far, with those of a motion."""
        given = self.scene.pipeline
        run = given.run.model_copy(update={"seed": given.run.seed + 1000 * len(self.found)})
        self.found += list(paths(replace(given, run=run, trajectories={"raster": motion})))
        return sites_along(join_paths(self.found))


@dataclass
class SiteRig(Rig):
    """A rig without a filter: what it says at each site is the true contrast with the errors of the simulated rig.

    Those of the smoother at 6 mm/s on rough skins, seeds 50 to 53: points scatter by 0.6 %, a line by 0.25 % over 3 mm
    and 0.4 % over 15 mm, all of a motion together by 0.4 %; a drift of the tare adds its force over 3.5 N.
    """

    sites: list[Sites] = field(default_factory=list)

    def sites_of(self, motion: Any) -> Sites:
        """All sites so far, with those of a motion."""
        dice = np.random.default_rng([self.scene.seed, len(self.sites)])
        if hasattr(motion, "visits"):
            place = np.array(motion.visits)
            standing, own = np.ones(len(place), bool), 0.006 * dice.standard_normal(len(place))
            time = np.linspace(2.0, motion.total_duration - 1.0, len(place))
        else:
            time, place = _along(motion)
            standing = np.zeros(len(place), bool)
            own = 0.0025 * _smooth(dice, len(place), 3) + 0.004 * _smooth(dice, len(place), 15)
        drift = self.scene.drift * (time - 1.0) / 3.5
        log = np.log1p(self.scene.contrast(place)) + own + drift + 0.004 * dice.standard_normal() + 11.6
        late = 1.0 + (self.sites[-1].time[-1] if self.sites else 0.0)
        self.sites.append(Sites(place, log, np.where(standing, 0.013, 0.0077), late + time, standing))
        columns = zip(*((s.place, s.log, s.std, s.time, s.standing) for s in self.sites), strict=True)
        return Sites(*(np.concatenate(column) for column in columns))


def _along(motion: Any) -> tuple[Floats, Floats]:
    """Times (n,) [s] and places (n, 2) [m], a millimetre apart, of a motion that stays on the skin."""
    time = np.arange(0.0, motion.total_duration, 0.01)
    setpoint = motion.at(time)
    time, place = time[setpoint.measuring], setpoint.position[setpoint.measuring, :2]
    way = np.r_[0.0, np.cumsum(np.hypot(*np.diff(place, axis=0).T))]
    _, rows = np.unique(np.floor(1e3 * way + 1e-6), return_index=True)
    return time[rows], place[rows]


def _smooth(dice: np.random.Generator, count: int, width: int) -> Floats:
    """Noise (n,) of unit variance that is alike over a width [mm]."""
    kernel = np.hanning(2 * width + 1)
    return np.convolve(dice.standard_normal(count + 2 * width), kernel / np.sqrt((kernel**2).sum()), "valid")


def first_line(given: Pipeline, y: float = 0.0) -> Trajectory:
    """One line through the middle of the box."""
    (motion,) = given.trajectories.values()
    part = given.registry.find("trajectory", "line-sweep")
    return part(  # type: ignore[no-any-return, operator]
        start=(BOX[0], y),
        end=(BOX[1], y),
        speed=motion.speed,  # type: ignore[attr-defined]
        settle=motion.settle,  # type: ignore[attr-defined]
        press=motion.press,  # type: ignore[attr-defined]
        surface=motion.surface,  # type: ignore[attr-defined]
    )


LEAST = 'depth="3.2 mm", radius="4.2 mm"'  # half as stiff 5 mm off its middle


def judged(scene: Scene, lumps: Iterable[Any], within: float = 8e-3) -> tuple[int, int]:
    """True lumps that were missed, and false lumps."""
    lumps = list(lumps)
    missed = sum(all(math.dist(m, at) > within for at in lumps) for m in scene.middles)
    false = sum(all(math.dist(m, at) > within for m in scene.middles) for at in lumps)
    return missed, false


def wilson(hits: int, count: int) -> tuple[float, float]:
    """Wilson's interval of a frequency, 95 %."""
    z, share = 1.96, hits / count
    middle, half = share + z**2 / (2 * count), z * math.sqrt(share * (1 - share) / count + z**2 / (4 * count**2))
    return (middle - half) / (1 + z**2 / count), (middle + half) / (1 + z**2 / count)
