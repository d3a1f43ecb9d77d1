"""How often comparisons of groups find a difference where none exists, at 5 %.

    python benchmarks/false_positives.py [--draws 2000] [--seed 56] [--mixed] [--only "groups of 10"]

Each draw has units such as animals, whose means scatter by 10 kPa about the same 100 kPa in all groups, and ten curves
of each unit that scatter by 5 kPa about its mean. A family is wrong if any of its pairs is found to differ. `--mixed`
fits mixed models to the same draws in place of the other tests. Prints the tables of docs/repeats.md.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence

import numpy as np
from palpate_kit.numerics.group_comparison import CURVE, GroupComparison, compare_groups

LEVEL = 0.05
_MEAN, _BETWEEN, _WITHIN, _CURVES = 100e3, 10e3, 5e3, 10
PAIRS = [(3, 3), (5, 5), (10, 10), (3, 5), (3, 10)]
FAMILIES = [(3, 3), (3, 5), (3, 10), (5, 3), (5, 10), (10, 3), (10, 5), (10, 10)]  # groups, and units of each


def draw(
    random: np.random.Generator, units: Sequence[int], scatter: Sequence[float]
) -> dict[str, list[tuple[str, float]]]:
    """Values of groups with so many units, each with its name; `scatter` between the units of each group [Pa]."""
    found = {}
    for k, (count, between) in enumerate(zip(units, scatter, strict=True)):
        means = _MEAN + between * random.standard_normal(count)
        values = means[:, None] + _WITHIN * random.standard_normal((count, _CURVES))
        found[f"g{k}"] = [(f"{k}-{i}", value) for i, row in enumerate(values.tolist()) for value in row]
    return found


def by_curve(groups: dict[str, list[tuple[str, float]]]) -> GroupComparison:
    """The same values, each taken for a unit of its own."""
    return compare_groups({name: [(str(i), v) for i, (_, v) in enumerate(g)] for name, g in groups.items()}, CURVE)


def smallest_games_howell(comparison: GroupComparison) -> float:
    """The p of a family by Games and Howell's test, of the pair that Welch's test separates most."""
    return min(p for pair in comparison.most_significant(1) if (p := comparison.games_howell(pair)) is not None)


def rows(draws: int, seed: int, mixed: bool, only: str) -> Iterator[tuple[str, dict[str, float]]]:
    """What was compared, and by which test how often a difference was found."""
    cases = [(f"{a} and {b} units", (a, b), (_BETWEEN, _BETWEEN)) for a, b in PAIRS]
    cases += [
        (f"{a} and {b} units, the first scattering twice as much", (a, b), (2 * _BETWEEN, _BETWEEN)) for a, b in PAIRS
    ]
    cases += [(f"{k} groups of {n} units", (n,) * k, (_BETWEEN,) * k) for k, n in FAMILIES]
    for number, (name, units, scatter) in enumerate(cases):
        if only not in name:
            continue
        random = np.random.default_rng([seed, number])
        found: dict[str, int] = {}
        for _ in range(draws):
            groups = draw(random, units, scatter)
            comparison = compare_groups(groups, "animal", mixed=mixed)
            smallest = {"mixed" if mixed else "welch": min(pair.corrected for pair in comparison.pairs)}
            if not mixed and len(units) == 2:
                smallest["single curves"] = min(pair.corrected for pair in by_curve(groups).pairs)
            if not mixed and len(units) > 2:
                smallest["games-howell"] = smallest_games_howell(comparison)
            for test, p in smallest.items():
                found[test] = found.get(test, 0) + (p < LEVEL)
        yield name, {test: count / draws for test, count in found.items()}


def main() -> None:
    """Print a row as each is measured."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=56)
    parser.add_argument("--mixed", action="store_true")
    parser.add_argument("--only", default="", help="part of the names of the rows")
    asked = parser.parse_args()
    tests = ("mixed",) if asked.mixed else ("welch", "games-howell", "single curves")
    print("| compared |", " | ".join(tests), "|")
    print("|---|" + "---|" * len(tests))
    for name, found in rows(asked.draws, asked.seed, asked.mixed, asked.only):
        cells = (f"{100 * found[test]:.1f} %" if test in found else "" for test in tests)
        print(f"| {name} |", " | ".join(cells), "|", flush=True)


if __name__ == "__main__":
    main()
