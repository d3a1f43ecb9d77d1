"""How often a patch remains where a search says that none does, on simulated scenes of 0 to 3 patches.

Run it with: python benchmarks/search.py [--count 100] [--first 7000] [--contrast 0.1] [--risk 0.05] [--sites]. One
process; seconds are those of the planned motions, not of the computer. Settings were chosen on seeds below 7000.
"""

from __future__ import annotations

import argparse
import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from palpate import Floats, Trajectory
from palpate.config import Pipeline, load_pipeline
from palpate_maps.area_search import AreaSearch, SearchSettings
from palpate_maps.map_analysis import Path2D, Sites, area_of, sites_along
from palpate_maps.path_reader import join_paths
from palpate_maps.search_motion import SearchMotion
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

    @functools.cached_property
    def pipeline(self) -> Pipeline:
        """The raster over the scene."""
        return replace(load_pipeline(RASTER, self.settings), sinks={})

    def contrast(self, places: Floats) -> Floats:
        """The true contrast (n,) over the specimen's own stiffness that the tip feels at places (n, 2) [m]."""
        specimen = self.pipeline.devices["rig"].specimen  # type: ignore[attr-defined]
        plain = specimen.model_copy(update={"inclusions": ()})
        return specimen.theta(*places.T)[0] / plain.theta(*places.T)[0] - 1


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
    rough, tilt = dice.uniform(0.02, 0.1), dice.uniform(-0.5, 0.5, 2)
    relief = f'{{roughness="{rough} mm", length="10 mm", tilt_x="{tilt[0]} deg", tilt_y="{tilt[1]} deg", seed={seed}}}'
    settings = [
        f"run.seed={seed}",
        'run.tracks=["dr/smoother"]',
        f"device.rig.specimen.relief={relief}",
        f'device.rig.specimen.scatter={{std=0.005, length="20 mm", seed={seed}}}',
        f"device.rig.specimen.inclusions=[{bodies}]",
        f"device.rig.drift={dice.uniform(-5, 5) / 3600} N/s",
        "device.rig.sensor_rate=500 Hz",
        f"trajectory.raster.speed={SPEED} mm/s",
        f"estimator.smoother.sweep_speed={SPEED} mm/s",
        "trajectory.raster.settle=1 s",
    ]
    return Scene(seed, middles, heights, settings)


@dataclass
class Rig:
    """The rig of a scene, and what it was told so far."""

    scene: Scene
    seconds: float = 0.0
    palpations: int = 0
    found: list[Path2D] = field(default_factory=list)
    tip: Floats | None = None

    def palpate(self, motion: Trajectory) -> Sites:
        """Make a motion; all sites so far."""
        given = self.scene.pipeline
        run = given.run.model_copy(update={"seed": given.run.seed + 1000 * len(self.found)})
        self.found += list(paths(replace(given, run=run, trajectories={"raster": motion})))
        ends = motion.at(np.array([0.0, motion.total_duration])).position[:, :2]
        if self.tip is not None:
            self.seconds += float(np.hypot(*(ends[0] - self.tip))) / TRAVEL
        self.tip = ends[1]
        self.seconds += motion.total_duration
        self.palpations += len(getattr(motion, "visits", [0]))
        return sites_along(join_paths(self.found))


@dataclass
class SiteRig(Rig):
    """A rig without a filter: what it says at each site is the true contrast with the errors of the simulated rig.

    Those of the smoother at 6 mm/s on rough skins, seeds 50 to 53: points scatter by 0.6 %, a line by 0.25 % over 3 mm
    and 0.4 % over 15 mm, all of a motion together by 0.4 %; a drift of the tare adds its force over 3.5 N.
    """

    sites: list[Sites] = field(default_factory=list)

    def palpate(self, motion: Trajectory) -> Sites:
        """Make a motion; all sites so far."""
        dice = np.random.default_rng([self.scene.seed, len(self.sites)])
        visits = getattr(motion, "visits", None)
        if visits is not None:
            place, standing, own = (
                np.array(visits),
                np.ones(len(visits), bool),
                0.006 * dice.standard_normal(len(visits)),
            )
        else:
            begin, end = np.array(motion.start), np.array(motion.end)  # type: ignore[attr-defined]
            count = int(1e3 * math.dist(begin, end)) + 1
            place, standing = begin + np.linspace(0, 1, count)[:, None] * (end - begin), np.zeros(count, bool)
            own = 0.0025 * _smooth(dice, count, 3) + 0.004 * _smooth(dice, count, 15)
        time = np.linspace(2.0, motion.total_duration - 1.0, len(place))
        drift = float(self.scene.settings[5].split("=")[1].split()[0]) * (time - 1.0) / 3.5
        log = np.log1p(self.scene.contrast(place)) + own + drift + 0.004 * dice.standard_normal() + 11.6
        late = 1.0 + (self.sites[-1].time[-1] if self.sites else 0.0)
        self.sites.append(Sites(place, log, np.where(standing, 0.013, 0.0077), late + time, standing))
        self.count(motion, place)
        columns = zip(*((s.place, s.log, s.std, s.time, s.standing) for s in self.sites), strict=True)
        return Sites(*(np.concatenate(column) for column in columns))

    def count(self, motion: Trajectory, place: Floats) -> None:
        """Seconds and palpations of a motion over places."""
        if self.tip is not None:
            self.seconds += float(np.hypot(*(place[0] - self.tip))) / TRAVEL
        self.tip = place[-1]
        self.seconds += motion.total_duration
        self.palpations += len(getattr(motion, "visits", [0]))


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


def searched(rig: Rig, settings: SearchSettings, budget: float, lines: bool = True) -> AreaSearch:
    """A search until it ends or its budget [s] is spent."""
    given = rig.scene.pipeline
    sites = rig.palpate(first_line(given))
    motion = SearchMotion(given, "raster", 2.0)
    search = AreaSearch(area_of(given, motion.own, sites.place, BOX), motion, settings)
    search.observe(sites, visited=False)
    while rig.seconds < budget:
        places = search.next_round()
        if not places or search.ended(places):
            break
        search.observe(rig.palpate(motion.along(places)), visited=True)
    return search


def judged(scene: Scene, lumps: Sequence[Floats], within: float = 8e-3) -> tuple[int, int]:
    """True lumps that were missed, and lumps that are none."""
    missed = sum(all(math.dist(m, at) > within for at in lumps) for m in scene.middles)
    false = sum(all(math.dist(m, at) > within for m in scene.middles) for at in lumps)
    return missed, false


LEAST = 'depth="3.2 mm", radius="4.2 mm"'  # half as stiff 5 mm beside its middle


def risk(seeds: Sequence[int], contrast: float, stated: float, sites: bool) -> None:
    """How often a patch remains where the search says that none does: 0 to 3 patches of the least contrast, or more."""
    remaining, ended, times, told, false = 0, 0, [], [], 0
    for seed in seeds:
        given = scene(seed, seed % 4, (contrast, contrast if seed // 4 % 2 else 3 * contrast), LEAST)
        rig = SiteRig(given) if sites else Rig(given)
        search = searched(rig, SearchSettings(contrast=contrast, risk=stated), 600.0)
        assert search.hiding is not None
        missed, wrong = judged(given, [*(item.lump.place for item in search.lumps), *search.patches])
        over = search.hiding.risk <= stated and rig.seconds < 600
        if over:
            ended, remaining = ended + 1, remaining + bool(missed)
            told.append(search.hiding.risk)
            times.append(rig.seconds)
        false += wrong
        peaks = ", ".join(f"{peak:.2f}" for peak in given.peaks)
        print(
            f"seed {seed}: {len(given.middles)} patches of {peaks}, {missed} missed, {wrong} false; "
            f"{rig.seconds:.0f} s, {rig.palpations} palpations, risk {search.hiding.risk:.3f}, "
            f"{'ended' if over else 'not ended'}",
            flush=True,
        )
    low, high = wilson(remaining, ended)
    print(
        f"{ended} of {len(seeds)} ended, stated {np.mean(told):.3f} on average; in {remaining} a patch remains: "
        f"{remaining / ended:.3f} ({low:.3f} to {high:.3f}); {false} false; {np.median(times):.0f} s"
    )


def wilson(hits: int, count: int) -> tuple[float, float]:
    """Wilson's interval of a frequency, 95 %."""
    z, share = 1.96, hits / count
    middle, half = share + z**2 / (2 * count), z * math.sqrt(share * (1 - share) / count + z**2 / (4 * count**2))
    return (middle - half) / (1 + z**2 / count), (middle + half) / (1 + z**2 / count)


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--first", type=int, default=7000)
    parser.add_argument("--contrast", type=float, default=0.1)
    parser.add_argument("--risk", type=float, default=0.05)
    parser.add_argument("--sites", action="store_true", help="errors of sites in place of the rig and its filter")
    given = parser.parse_args()
    seeds = range(given.first, given.first + given.count)
    risk(seeds, given.contrast, given.risk, given.sites)


if __name__ == "__main__":
    main()
