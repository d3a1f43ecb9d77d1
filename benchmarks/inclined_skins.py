"""Tilted and curved skins: E where they are stated, and what is reported where they are not.

Run: python benchmarks/inclined_skins.py [DRAWS] [--first N]. Each draw is a palpation on the simulated rig as in
pipelines/point.toml, R 5 mm: tilt 0 to 30 deg, skin flat, bulging, hollow or a cylinder with a curvature up to
1/(15 mm), friction 0, 0.3 or 1. It is estimated twice: with `skin` stated, its inclination off by a normal error of
1.5 deg and its radius of 5 %, both declared; and with nothing stated. A draw is right where E is within its 95 %.
"""

import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from palpate_engine import load_pipeline, run_pipeline

PIPELINE = Path(__file__).parent.parent / "pipelines" / "point.toml"
TRUE = 112.5e3  # [Pa]
WIDE = 1.96
TILT_STD, RADIUS_STD = 1.5, 0.05  # [deg], of itself
SHAPES = ("flat", "bulge", "hollow", "cylinder across", "cylinder along")


@dataclass(frozen=True)
class Estimate:
    """E of one palpation."""

    error: float  # of the truth
    std: float  # combined, of the truth
    flags: tuple[str, ...]
    corrected: tuple[float, float] | None = None  # error and combined, by the force along the normal

    @property
    def right(self) -> bool:
        """Within its 95 %."""
        return abs(self.error) <= WIDE * self.std

    @property
    def by_three_axes(self) -> tuple[float, float]:
        """Error and combined by all axes of the force, where they say more than the one along the tool."""
        return (self.error, self.std) if self.corrected is None else self.corrected


@dataclass(frozen=True)
class Draw:
    """One palpation, estimated with and without what is known of the skin."""

    tilt: float  # [deg]
    shape: str
    radius: float  # [mm]
    friction: float
    stated: Estimate
    silent: Estimate

    @property
    def by_tilt(self) -> float:
        """What the tilt alone makes of E: cos(t)^1.5 (cos t + f sin t) - 1, f the friction, where the tip touches."""
        along = radii(self.shape, self.radius)[0]
        size = np.inf if along == "flat" else float(along.split()[0])
        t = np.arcsin(np.sin(np.radians(self.tilt)) / (1 + 5 / size))
        friction = min(self.friction, 2 / 3 * np.tan(t))
        return float(np.cos(t) ** 1.5 * (np.cos(t) + friction * np.sin(t)) - 1)

    @property
    def can_show(self) -> bool:
        """Whether the tilt alone, which the force across the tool can show, takes E out of its 95 %."""
        return not self.silent.right and abs(self.by_tilt) > WIDE * self.silent.std

    @property
    def is_told(self) -> bool:
        """Whether it is said where nothing is stated."""
        return "inclined-skin" in self.silent.flags


def estimate(sets: list[str]) -> Estimate:
    """E of the shipped point palpation with changes."""
    with tempfile.TemporaryDirectory() as folder:
        result = run_pipeline(load_pipeline(PIPELINE, sets), Path(folder) / "run")
    track = result.tracks["dr/kinematic"]
    found = track.parameters["elasticity"]
    flags = tuple(flag.code for flag in track.flags if flag.severity in ("doubtful", "invalid"))
    other = found.corrected
    corrected = None if other is None else (other.value / TRUE - 1, other.combined / TRUE)
    return Estimate(found.value / TRUE - 1, found.combined / TRUE, flags, corrected)


def radii(shape: str, radius: float) -> tuple[str, str]:
    """Of the skin along the tilt and across it, as a pipeline has them."""
    size = f"{-radius if shape == 'hollow' else radius:.6g} mm"
    if shape == "flat":
        return "flat", "flat"
    return ("flat" if shape == "cylinder along" else size), ("flat" if shape == "cylinder across" else size)


def draw(seed: int) -> Draw:
    """The palpation of a seed."""
    random = np.random.default_rng([40, seed])
    tilt, shape = float(random.uniform(0, 30)), SHAPES[int(random.integers(len(SHAPES)))]
    radius, friction = float(15 / random.uniform(0.05, 1.0)), float(random.choice((0.0, 0.3, 1.0)))
    along, across = radii(shape, radius)
    rig = "device.rig.specimen"
    truth = [
        f"run.seed={seed}",
        f"{rig}.relief={{tilt_x='{tilt:.6g} deg',radius_x='{along}',radius_y='{across}'}}",
        f"{rig}.friction={friction}",
    ]
    read = abs(tilt + TILT_STD * random.standard_normal())
    seen = radius * (1 + RADIUS_STD * random.standard_normal())
    along, across = radii(shape, seen)
    stds = {"inclination": f"{TILT_STD} deg"} | {
        key: f"{RADIUS_STD * seen:.4g} mm"
        for key, size in (("skin_radius", along), ("skin_radius_across", across))
        if size != "flat"
    }
    declared = ",".join(f"{key}='{value}'" for key, value in stds.items())
    skin = f"inclination='{read:.6g} deg',skin_radius='{along}',skin_radius_across='{across}'"
    stated = estimate([*truth, f"model.dr.skin={{{skin}}}", f"run.uncertainties={{{declared}}}"])
    return Draw(tilt, shape, radius, friction, stated, estimate(truth))


def spread(errors: Any, stds: Any) -> str:
    """RMS error, and mean standard uncertainty, in per cent."""
    return f"{100 * np.sqrt(np.mean(np.square(errors))):.1f}, {100 * np.mean(stds):.1f} %"


def table(draws: list[Draw]) -> str:
    """By tilt: how many are right where the skin is stated; how many are wrong where it is not, and reported."""
    lines = [
        "| tilt | draws | stated: within 95 % | error, u | three axes: within 95 % | error, u | flagged | "
        "silent: wrong | by the tilt | reported |",
        f"|{10 * '---|'}",
    ]
    for low, high in ((0, 5), (5, 10), (10, 20), (20, 30), (0, 30)):
        rows = [one for one in draws if low <= one.tilt < high]
        if not rows:
            continue
        errors, stds = np.transpose([one.stated.by_three_axes for one in rows])
        cells: list[Any] = [
            f"{low} to {high} deg",
            len(rows),
            sum(one.stated.right for one in rows),
            spread([one.stated.error for one in rows], [one.stated.std for one in rows]),
            int(np.sum(np.abs(errors) <= WIDE * stds)),
            spread(errors, stds),
            sum(bool(one.stated.flags) for one in rows),
            sum(not one.silent.right for one in rows),
            sum(one.can_show for one in rows),
            sum(one.can_show and one.is_told for one in rows),
        ]
        lines.append(f"| {' | '.join(map(str, cells))} |")
    return "\n".join(lines)


def main() -> None:
    """Print the table, and every draw that is not right where its skin is stated, or wrong and not reported."""
    numbers = [int(word) for word in sys.argv[1:] if word.isdigit()]
    count, first = (numbers[0] if numbers else 100), (numbers[1] if "--first" in sys.argv else 0)
    with ProcessPoolExecutor(2) as pool:
        draws = list(pool.map(draw, range(first, first + count)))
    print(table(draws))
    for seed, one in enumerate(draws, first):
        if not one.stated.right or one.stated.flags or (one.can_show and not one.is_told):
            print(seed, one)


if __name__ == "__main__":
    main()
