"""Lumps of the stated limit in rasters of the simulated rig: how many are found of those that an exam excludes.

Run it with: python benchmarks/exclusion.py virtual|simulated [--count 20] [--first 9000] [--track dr/smoother].
One process. A raster of 40 mm x 30 mm at 6 mm/s with a relief states which lumps it excludes. Then lumps of that
contrast are put at random places, one at a time: `virtual` raises the recorded force by 1 + c g, at three places for
each of three widths, and lets the track estimate again; `simulated` puts a sphere below the skin of another run.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from palpate import Floats, Samples
from palpate_engine.config import Pipeline, load_pipeline
from palpate_maps.body_field import FWHM
from palpate_maps.lump_criteria import TrackResponse
from palpate_maps.map_analysis import Findings, LumpSettings, Path2D, find_lumps, sites_along
from palpate_maps.track_response import response_of
from palpate_simulation.skin_under_tip import SkinUnderTip
from sweeps import paths_of, samples_of

RASTER = Path(__file__).parent.parent / "pipelines" / "raster.toml"
SIZE = (40e-3, 30e-3)  # [m]
WIDTHS = (6e-3, 10e-3, 15e-3)  # [m] of virtual lumps
SPHERE = 'shape="sphere", depth="3 mm", radius="3.5 mm"'


def raster(seed: int, track: str, *more: str) -> Pipeline:
    """The example raster over a smaller area, faster, without inclusions; nothing is recorded."""
    settings = [
        f"run.seed={seed}",
        f'run.tracks=["{track}"]',
        f"device.rig.specimen.relief.seed={seed}",
        "device.rig.specimen.inclusions=[]",
        'trajectory.raster.size=["40 mm", "30 mm"]',
        "trajectory.raster.speed=6 mm/s",
        "estimator.kinematic.sweep_speed=6 mm/s",
        "estimator.smoother.sweep_speed=6 mm/s",
        'estimator.afekf={type="afekf"}',
        *more,
    ]
    return replace(load_pipeline(RASTER, settings), sinks={})


def path_of(pipeline: Pipeline, samples: Samples) -> Path2D:
    """The path of the one track."""
    (path,) = paths_of(pipeline, samples)
    return path


def stated(pipeline: Pipeline, samples: Samples) -> tuple[TrackResponse, Findings]:
    """The track's response, and what a raster without a lump finds and excludes."""
    response = response_of(pipeline, samples, "elasticity")
    assert response is not None
    return response, find_lumps(sites_along(path_of(pipeline, samples)), LumpSettings(response=response))


def limit(findings: Findings, width: float) -> float:
    """The contrast that is excluded at a width [m], interpolated between those that are stated."""
    widths, contrasts = np.array([(power.width, power.contrast) for power in findings.excluded]).T
    return float(np.exp(np.interp(np.log(width), np.log(widths), np.log(contrasts))))


def places(dice: np.random.Generator, count: int) -> list[Floats]:
    """Random places [m] in the area."""
    return list(dice.uniform([-SIZE[0] / 2, -SIZE[1] / 2], [SIZE[0] / 2, SIZE[1] / 2], (count, 2)))


def is_found(findings: Findings, place: Floats, width: float) -> bool:
    """True where a lump is nearer than its width, or 5 mm."""
    return any(math.dist(lump.place, place) < max(width, 5e-3) for lump in findings.lumps)


def virtual(seeds: Iterator[int], track: str) -> None:
    """Virtual lumps of the stated contrast, by their widths."""
    hits = {width: list[bool]() for width in WIDTHS}
    for seed in seeds:
        pipeline = raster(seed, track)
        samples = samples_of(pipeline)
        response, findings = stated(pipeline, samples)
        print(f"{seed}: {response}, {[round(100 * limit(findings, width), 1) for width in WIDTHS]} %", flush=True)
        for number, width in enumerate(WIDTHS):
            contrast = limit(findings, width)
            for middle in places(np.random.default_rng([seed, number]), 3) if math.isfinite(contrast) else ():
                shape = np.exp(-0.5 * ((samples.lateral - middle) ** 2).sum(axis=1) / (width / FWHM) ** 2)
                raised = replace(samples, force=samples.force * (1 + contrast * np.nan_to_num(shape)))
                hits[width].append(is_found(find_lumps(sites_along(path_of(pipeline, raised))), middle, width))
    for width, found_at in hits.items():
        print(f"width {1e3 * width:g} mm: found {sum(found_at)} of {len(found_at)}")
    every = [hit for found_at in hits.values() for hit in found_at]
    print(f"all: {sum(every)} of {len(every)}")


def simulated(seeds: Iterator[int], track: str) -> None:
    """Spheres below the skin whose contrast as it is felt is the stated one at their width as it is felt."""
    hits = []
    for seed in seeds:
        empty = raster(seed, track)
        _, findings = stated(empty, samples_of(empty))
        (place,) = places(np.random.default_rng([seed, 9]), 1)
        width = felt_width(raster(seed, track, inclusion(np.zeros(2), 0.1)))
        contrast = limit(findings, width)
        pipeline = raster(seed + 1, track, inclusion(place, contrast))
        found = find_lumps(sites_along(path_of(pipeline, samples_of(pipeline))))
        hits.append(is_found(found, place, width))
        x, y = 1e3 * place
        print(f"{seed}: {1e3 * width:.1f} mm, {100 * contrast:.1f} % at {x:.1f}, {y:.1f}: {hits[-1]}", flush=True)
    print(f"simulated: {sum(hits)} of {len(hits)}")


def inclusion(place: Floats, peak: float) -> str:
    """The setting of one sphere."""
    x, y = (1e3 * place).tolist()
    return f'device.rig.specimen.inclusions=[{{{SPHERE}, place=["{x} mm", "{y} mm"], peak={peak}}}]'


def felt_width(pipeline: Pipeline) -> float:
    """The width [m] at half its height of the rig's inclusion in the middle, along x."""
    x = np.linspace(0.0, 20e-3, 401)
    line = np.column_stack([x, 0 * x, 0 * x])
    value = SkinUnderTip(pipeline.devices["rig"].specimen, line).theta[0]  # type: ignore[attr-defined]
    contrast = value / value[-1] - 1
    return 2 * float(x[int(np.argmax(contrast < contrast[0] / 2))])


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["virtual", "simulated"])
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--first", type=int, default=9000)
    parser.add_argument("--track", default="dr/smoother")
    given = parser.parse_args()
    seeds = iter(range(given.first, given.first + given.count))
    {"virtual": virtual, "simulated": simulated}[given.what](seeds, given.track)


if __name__ == "__main__":
    main()
