"""A rule that was set aside: a touch stops where the force is much too small for its depth, by the stated stiffness.

``python benchmarks/lying_sensors.py 1000``: so many rigs of `force_rise.py`, sound, and with sensors that lie smoothly.
The rule stops where the stiffest material would pass `force`, and less than a share of that is read. Printed for
shares, and for a stiffness that is stated rightly or too high by a factor: sound rigs that it stops, lies that it
stops of those that do harm, and the median of the largest true force, in parts of `force`, without it and with it.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Callable

import numpy as np
from force_rise import SoundRig, drawn

_FORGOTTEN = 1.0  # [s]


def _high_pass(force: np.ndarray, time: np.ndarray) -> np.ndarray:
    """What is left of a force (n,) whose constant part is lost."""
    share, mean = -np.expm1(-(time[1] - time[0]) / _FORGOTTEN), 0.0
    passed = np.empty_like(force)
    for k, value in enumerate(force.tolist()):
        mean += (value - mean) * share
        passed[k] = value - mean
    return passed


LIES: dict[str, Callable[[np.ndarray, np.ndarray], np.ndarray]] = {
    "kg for N": lambda force, _: 0.102 * force,
    "half scale": lambda force, _: 0.5 * force,
    "square root": lambda force, _: np.sqrt(force),
    "10 N not felt": lambda force, _: np.maximum(force - 10.0, 0.0),
    "0.5 s old": lambda force, time: np.interp(time - 0.5, time, force),
    "high-pass, 1 s": _high_pass,
}


def stops(rig: SoundRig, reading: np.ndarray, stiffness: float, share: float) -> tuple[int, int]:
    """Samples until the force that is read stops a rig, and until the rule does; its length where nothing does."""
    by_depth = stiffness * np.maximum(-rig.height, 0.0)
    by_force = np.flatnonzero(reading > rig.stop)
    by_rule = np.flatnonzero((by_depth > rig.stop + rig.room) & (reading + rig.noise < share * by_depth))
    whole = len(reading)
    first, second = (int(found[0]) if len(found) else whole for found in (by_force, by_rule))
    return first, second


def row(rigs: list[SoundRig], factor: float, share: float) -> str:
    """A row of the table."""
    cells = [f"{factor:g}", f"{share:g}"]
    sound = [stops(rig, rig.force, factor * rig.stiffness, share) for rig in rigs]
    cells.append(f"{sum(rule < force for force, rule in sound)} of {len(rigs)}")
    for law in LIES.values():
        ends = []
        for rig in rigs:
            force, rule = stops(rig, law(rig.force, rig.time), factor * rig.stiffness, share)
            without = float(rig.force[: force + 1].max()) / (rig.stop + rig.room)
            if without > 1.0:
                ends.append((without, float(rig.force[: min(force, rule) + 1].max()) / (rig.stop + rig.room)))
        before, after = np.median(np.array(ends), axis=0)
        cells.append(f"{sum(b < a for a, b in ends)} of {len(ends)}, {before:.1f} to {after:.1f}")
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """The table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("count", type=int, nargs="?", default=1000)
    rigs = [drawn(seed, is_whole=True) for seed in range(parser.parse_args().count)]
    print(f"| stiffness stated, times the true | share | sound rigs stopped | {' | '.join(LIES)} |")
    print("|---|---|---|" + "---|" * len(LIES))
    for factor, share in itertools.product((1.0, 3.0, 10.0), (0.05, 0.2)):
        print(row(rigs, factor, share))


if __name__ == "__main__":
    main()
