"""Processor time that a search takes for its next place after hundreds of palpations.

Run it with: OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python benchmarks/search_speed.py [--sites 500] [--rounds 12].
Points lie at random in a scene of two lumps; each round adds three. Times are of the process, in one thread.
"""

from __future__ import annotations

import argparse
import time
from typing import get_args

import numpy as np
from palpate_maps.area_search import AreaSearch, SearchSettings
from palpate_maps.map_analysis import Sites, area_of
from palpate_maps.next_places import Aim
from palpate_maps.search_motion import SearchMotion
from search_scenes import BOX, LEAST, Scene, scene


def points(given: Scene, count: int) -> Sites:
    """Points anywhere in the box, with an error of 0.6 %."""
    dice = np.random.default_rng(given.seed)
    place = dice.uniform((BOX[0], BOX[2]), (BOX[1], BOX[3]), (count, 2))
    log = 11.6 + np.log1p(given.contrast(place)) + 0.006 * dice.standard_normal(count)
    return Sites(place, log, np.full(count, 0.012), 5.0 * np.arange(count), np.ones(count, bool))


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sites", type=int, default=500)
    parser.add_argument("--rounds", type=int, default=12)
    asked = parser.parse_args()
    given = scene(7002, 2, (0.15, 0.35), LEAST)
    motion = SearchMotion(given.pipeline, "raster", 2.0)
    every = points(given, asked.sites + 3 * asked.rounds)
    area = area_of(given.pipeline, motion.own, every.place, BOX)
    print("| aim | take up three points, ms: median, largest | choose the next, ms: median, largest |\n|---|---|---|")
    for aim in get_args(Aim):
        search = AreaSearch(area, motion, SearchSettings(aim, contrast=0.1, risk=0.05))
        search.observe(every[: asked.sites], visited=False)
        search.next_round()
        taken, chosen = [], []
        for number in range(1, asked.rounds + 1):
            begin = time.process_time()
            search.observe(every[: asked.sites + 3 * number], visited=True)
            between = time.process_time()
            search.next_round()
            taken.append(1e3 * (between - begin))
            chosen.append(1e3 * (time.process_time() - between))
        cells = (f"{np.median(times):.0f}, {max(times):.0f}" for times in (taken, chosen))
        print(f"| {aim} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
