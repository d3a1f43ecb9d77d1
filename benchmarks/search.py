"""Searches side by side on simulated scenes, and how often a patch remains where a search says that none does.

Run it with: python benchmarks/search.py rivals|risk|skins [--count 100] [--first 7000] [--rig]. One process; seconds
are those of the planned motions, not of the computer. Without --rig the errors of sites are drawn as those of the
simulated rig's smoother were measured. Settings were chosen on seeds below 7000.

rivals: two lumps of 15 to 35 % in 60 mm x 40 mm. All begin with one line at 6 mm/s through the middle but the raster,
whose lines are all; "find by points" makes no others. "found" is when the lumps that `palpate map lumps` finds are both
and no others, "outlined" when the mean of the field, above 10 %, has an intersection over union of 0.8 with the truth:
a judge that knows the truth ends the rivals, which have no rule to end by; `find` goes on until its own rule ends it.

skins: as risk, over half an ellipsoid by its formula, by triangles and by touches, and over a bowl of triangles.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import Floats
from palpate_maps.area_search import AreaSearch, SearchSettings
from palpate_maps.map_analysis import Knowledge, Sites, area_of, find_lumps
from palpate_maps.search_motion import SearchMotion
from search_scenes import BOX, LEAST, SKINS, Rig, Scene, SiteRig, first_line, judged, scene, skin_scene, wilson

BUDGET = 600.0  # [s]
CONTRAST = 0.1


@dataclass
class Moment:
    """How far a search has come after one of its motions."""

    seconds: float
    palpations: int
    missed: int
    false: int
    overlap: float  # intersection over union of the regions above the contrast


Chooser = Callable[[Knowledge], int | None]


def overlap(scene: Scene, known: Knowledge) -> float:
    """Intersection over union of the true region above the contrast and the field's."""
    true = scene.contrast(known.field.nodes) >= CONTRAST
    seen = known.field.mean(known.base.mean) - known.base.mean >= np.log1p(CONTRAST)
    return float(np.count_nonzero(true & seen) / max(np.count_nonzero(true | seen), 1))


def moment(rig: Rig, sites: Sites, known: Knowledge) -> Moment:
    """After a motion: its lumps against the truth, and its field."""
    missed, false = judged(rig.scene, (lump.place for lump in find_lumps(sites).lumps))
    return Moment(rig.seconds, rig.palpations, missed, false, overlap(rig.scene, known))


def points(rig: Rig, choose: Chooser) -> Iterator[Moment]:
    """One point after the other, each at the node that is chosen."""
    given = rig.scene.pipeline
    sites = rig.palpate(first_line(given))
    motion = SearchMotion(given, "raster", 2.0)
    known = Knowledge.of(sites, area_of(given, motion.own, sites.place, BOX).nodes)
    yield moment(rig, sites, known)
    while rig.seconds < BUDGET and (node := choose(known)) is not None:
        sites = rig.palpate(motion.along([known.proposal(CONTRAST, node)]))
        known = Knowledge.of(sites, before=known)
        yield moment(rig, sites, known)


def _open(known: Knowledge) -> NDArray[np.bool_]:
    """Nodes that are not palpated yet."""
    visited = known.known.place[known.known.standing]
    return np.asarray((np.linalg.norm(known.field.nodes[:, None] - visited[None], axis=2) > 2e-3).all(axis=1))


def upper_bound(known: Knowledge) -> int:
    """GP-UCB (Srinivas 2010) with a factor of 2."""
    score = known.field.mean(known.base.mean) + 2 * known.field.std
    return int(np.argmax(np.where(_open(known), score, -np.inf)))


def improvement(known: Knowledge) -> int:
    """Expected improvement (Jones 1998) over the largest mean."""
    from scipy.stats import norm

    mean, std = known.field.mean(known.base.mean), known.field.std
    z = (mean - mean.max()) / std
    return int(np.argmax(np.where(_open(known), std * (z * norm.cdf(z) + norm.pdf(z)), -np.inf)))


class LevelSet:
    """Level-set estimation (Gotovos 2013): intersected intervals of 2 standard deviations, largest ambiguity."""

    def __init__(self) -> None:
        self.field: object = None
        self.low: Floats | float = -np.inf
        self.high: Floats | float = np.inf

    def __call__(self, known: Knowledge) -> int:
        """The most ambiguous node."""
        mean, std = known.field.mean(known.base.mean), known.field.std
        if known.field is not self.field:  # of another kernel
            self.field, self.low, self.high = known.field, -np.inf, np.inf
        self.low, self.high = np.maximum(self.low, mean - 2 * std), np.minimum(self.high, mean + 2 * std)
        level = known.base.mean + np.log1p(CONTRAST)
        ambiguity = np.minimum(self.high - level, level - self.low)
        return int(np.argmax(np.where(_open(known), ambiguity, -np.inf)))


class Grid:
    """Points of a grid, 5 mm apart, row after row."""

    def __init__(self) -> None:
        x, y = np.arange(BOX[0], BOX[1] + 1e-6, 5e-3), np.arange(BOX[2], BOX[3] + 1e-6, 5e-3)
        rows = [(a, b) for k, b in enumerate(y) for a in (x if k % 2 == 0 else x[::-1])]
        self.left = iter(rows)

    def __call__(self, known: Knowledge) -> int | None:
        """The next node of the grid."""
        place = next(self.left, None)
        return None if place is None else int(np.argmin(np.linalg.norm(known.field.nodes - place, axis=1)))


def raster(rig: Rig) -> Iterator[Moment]:
    """The lines of the raster, 5 mm apart; interrupted after each."""
    given = rig.scene.pipeline
    motion: Any = given.trajectories["raster"]
    sites = rig.palpate(motion)
    nodes = area_of(given, motion, sites.place, BOX).nodes
    rows = np.round((sites.place[:, 1] - BOX[2]) / motion.pitch)
    for line in range(2, motion.lines):
        part = sites[np.maximum.accumulate(rows) <= line]
        now = moment(rig, part, Knowledge.of(part, nodes))
        now.seconds = rig.seconds * (line + 1) / motion.lines
        now.palpations = line + 1
        yield now


class PointMotion(SearchMotion):
    """Motions without lines."""

    @property
    def line_speed(self) -> float | None:
        """None."""
        return None


def ours(
    rig: Rig, settings: SearchSettings, end: list[AreaSearch], motions: type[SearchMotion] = SearchMotion
) -> Iterator[tuple[Sites, Knowledge]]:
    """A search by `palpate map search`, until it ends by itself, which is added to `end`."""
    given = rig.scene.pipeline
    sites = rig.palpate(first_line(given))
    (name,) = given.trajectories
    motion = motions(given, name, 2.0)
    search = AreaSearch(area_of(given, motion.own, sites.place, BOX), motion, settings)
    search.observe(sites, visited=False)
    while True:
        assert search._knowledge is not None
        yield sites, search._knowledge
        places = search.next_round()
        if rig.seconds >= BUDGET:
            return
        if not places or search.ended():
            break
        sites = rig.palpate(motion.along(places))
        search.observe(sites, visited=True)
    end.append(search)


NAMES = ("grid", "raster", "GP-UCB", "expected improvement", "level set", "find by points", "find", "outline")


def rivals(seeds: Sequence[int], rig_of: type[Rig], names: Sequence[str] = NAMES) -> None:
    """Ours and others on the same scenes of two lumps."""
    found: dict[str, list[tuple[float, int]]] = {name: [] for name in names}
    outlined: dict[str, list[float]] = {name: [] for name in names}
    last: dict[str, list[Moment]] = {name: [] for name in names}
    for seed in seeds:
        given = scene(seed, 2, (0.15, 0.35), LEAST)
        for name in names:
            moments = list(_watched(name, _moments(name, rig_of(given))))
            first = next((m for m in moments if not m.missed and not m.false), None)
            found[name].append((first.seconds, first.palpations) if first else (math.inf, 0))
            outlined[name].append(next((m.seconds for m in moments if m.overlap >= 0.8), math.inf))
            last[name].append(moments[-1])
        print(
            f"seed {seed}: " + ", ".join(f"{n} {found[n][-1][0]:.0f}/{outlined[n][-1]:.0f}" for n in names), flush=True
        )
    print("| search | found: s | palpations | outlined: s | at the end: s | missed | false | overlap |")
    print("|---|---|---|---|---|---|---|---|")
    for name in names:
        end = last[name]
        medians = [np.median(column) for column in (*zip(*found[name], strict=True), outlined[name])]
        seconds, shared = (np.median([getattr(m, key) for m in end]) for key in ("seconds", "overlap"))
        missed, false = sum(m.missed for m in end), sum(m.false for m in end)
        cells = [*(f"{value:.0f}" for value in (*medians, seconds)), str(missed), str(false), f"{shared:.2f}"]
        print(f"| {name} | {' | '.join(cells)} |")


def _watched(name: str, moments: Iterator[Moment]) -> Iterator[Moment]:
    """The moments of a search until the judge has seen all: of `find` until its own end, of the raster all."""
    found = outlined = False
    for now in moments:
        yield now
        found, outlined = found or not (now.missed or now.false), outlined or now.overlap >= 0.8
        if found and outlined and not name.startswith(("find", "raster")):
            return


def _moments(name: str, rig: Rig) -> Iterator[Moment]:
    choosers: dict[str, Callable[[], Chooser]] = {
        "grid": Grid,
        "GP-UCB": lambda: upper_bound,
        "expected improvement": lambda: improvement,
        "level set": LevelSet,
    }
    if name == "raster":
        return raster(rig)
    if name in choosers:
        return points(rig, choosers[name]())
    if name == "outline":
        rounds = ours(rig, SearchSettings("outline", contrast=CONTRAST), [])
        return (moment(rig, *known) for known in rounds)
    motions = PointMotion if name == "find by points" else SearchMotion
    rounds = ours(rig, SearchSettings(contrast=CONTRAST, risk=0.05), [], motions)
    return (moment(rig, *known) for known in rounds)


def flat_scene(seed: int) -> Scene:
    """0 to 3 patches of the least contrast, or more."""
    return scene(seed, seed % 4, _peaks(seed), LEAST)


def curved_scene(seed: int) -> Scene:
    """0 to 3 patches below one of the skins, all of which come with each number of patches."""
    return skin_scene(SKINS[seed % 4], seed, seed // 4 % 4, _peaks(seed // 4), _skin_files())


@cache
def _skin_files() -> Path:
    """The folder of this process for the files of skins."""
    return Path(tempfile.mkdtemp(prefix="palpate-skins-"))


def _peaks(seed: int) -> tuple[float, float]:
    return CONTRAST, CONTRAST if seed // 4 % 2 else 3 * CONTRAST


def risk(
    seeds: Sequence[int], rig_of: type[Rig], scene_of: Callable[[int], Scene] = flat_scene, stated: float = 0.05
) -> None:
    """How often a patch remains where the search says that none does: 0 to 3 patches of the least contrast, or more."""
    remaining, ended, times, told, false = 0, 0, [], [], 0
    for seed in seeds:
        given = scene_of(seed)
        rig, end = rig_of(given), list[AreaSearch]()
        for _ in ours(rig, SearchSettings(contrast=CONTRAST, risk=stated), end):
            pass
        peaks = ", ".join(f"{peak:.2f}" for peak in given.peaks)
        print(
            f"seed {seed}: {len(given.middles)} patches of {peaks}; {rig.seconds:.0f} s, {rig.palpations} palpations",
            end="",
        )
        for search in end:
            assert search.hiding is not None
            missed, wrong = judged(given, [*(item.lump.place for item in search.lumps), *search.patches])
            ended, remaining, false = ended + 1, remaining + bool(missed), false + wrong
            told.append(search.hiding.risk)
            times.append(rig.seconds)
            print(f"; {missed} missed, {wrong} false, risk {search.hiding.risk:.3f}", end="")
        print(flush=True)
    low, high = wilson(remaining, ended)
    print(
        f"{ended} of {len(seeds)} ended, stated {np.mean(told):.3f} on average; in {remaining} a patch remains: "
        f"{remaining / ended:.3f} ({low:.3f} to {high:.3f}); {false} false; {np.median(times):.0f} s"
    )


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["rivals", "risk", "skins"])
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--first", type=int, default=7000)
    parser.add_argument("--rig", action="store_true", help="the simulated rig and its filter, not errors of sites")
    parser.add_argument("--names", nargs="+", default=NAMES, choices=NAMES, help="of the rivals")
    given = parser.parse_args()
    seeds, rig = range(given.first, given.first + given.count), Rig if given.rig else SiteRig
    if given.what == "rivals":
        rivals(seeds, rig, given.names)
    else:
        risk(seeds, rig, flat_scene if given.what == "risk" else curved_scene)


if __name__ == "__main__":
    main()
