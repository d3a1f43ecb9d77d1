"""Scenes of a search: lumps in a rough silicone, and rigs that palpate them and count seconds of motion."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from palpate import Floats, Trajectory
from palpate_engine.config import Pipeline, load_pipeline
from palpate_maps.map_analysis import Path2D, Sites, sites_along
from palpate_maps.path_reader import join_paths
from palpate_simulation.skin_under_tip import SkinUnderTip
from sweeps import paths

RASTER = Path(__file__).parent.parent / "pipelines" / "raster.toml"
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
        return replace(load_pipeline(RASTER, self.settings), sinks={})

    def contrast(self, places: Floats) -> Floats:
        """The true contrast (n,) over the specimen's own stiffness that the tip feels at places (n, 2) [m]."""
        specimen = self.pipeline.devices["rig"].specimen  # type: ignore[attr-defined]
        plain = specimen.model_copy(update={"inclusions": ()})
        tips = np.pad(places, ((0, 0), (0, 1)))
        return SkinUnderTip(specimen, tips).theta[0] / SkinUnderTip(plain, tips).theta[0] - 1


def scene(seed: int, count: int, peaks: tuple[float, float], body: str) -> Scene:
    """Spheres 20 mm or more apart anywhere in the box, with contrasts up to a factor between them, on a rough skin."""
    dice = np.random.default_rng(seed)
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
    motion = given.trajectories["raster"]
    part = given.registry.find("trajectory", "line-sweep")
    return part(  # type: ignore[no-any-return, operator]
        start=(BOX[0], y),
        end=(BOX[1], y),
        speed=motion.speed,
        settle=motion.settle,
        press=motion.press,  # type: ignore[attr-defined]
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
