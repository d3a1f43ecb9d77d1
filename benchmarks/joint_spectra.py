"""Coverage of the laws that `palpate fit spectrum` fits to several recordings: how often 95 % hold the truth.

Run: python benchmarks/joint_spectra.py [DRAWS]. A Kelvin-Voigt solid of 112.5 kPa and 362 Pa s, three to eight
recordings of it, each with one or more lines from 0.5 to 8 Hz. Radius (0.5 %), Poisson's ratio (0.0115) and mass (5 %)
have one error for all lines of a draw, as they are declared; the force is late by up to a millisecond; recordings
scatter by 0 to 8 % in G' and as much in G''; noise is 0.05 to 0.5 % of G*. Lines are made here, not by the product.
"""

from __future__ import annotations

import argparse

import numpy as np
from palpate_spectra.complex_moduli import ModulusLine
from palpate_spectra.law_fits import LAWS, fit_law

E, ETA = 112.5e3, 362.0
RADIUS, NU, MASS = 0.005, 0.0115, 0.05  # relative, relative of G*, relative
INERTIA = 0.14 / (8 * 4.5e-3)  # [kg/m] of the tip over 4/(1 - nu) times the contact radius


def drawn_lines(random: np.random.Generator, recordings: int, scatter: float, sines: int) -> list[ModulusLine]:
    """Lines of a draw."""
    noise, late = float(np.exp(random.uniform(np.log(5e-4), np.log(5e-3)))), float(random.uniform(-1e-3, 1e-3))
    radius, poisson, mass = random.standard_normal(3) * [RADIUS / 2, NU, MASS]
    found = []
    for k in range(recordings):
        storage, loss = 1 + scatter * random.standard_normal(2)
        for frequency in np.sort(np.exp(random.uniform(np.log(0.5), np.log(8.0), sines))).tolist():
            omega = 2 * np.pi * frequency
            true = complex(E / 3 * storage, omega * ETA * loss)
            inertia = INERTIA * omega**2
            felt = (true * (1 + radius + poisson) - inertia) * np.exp(-1j * omega * late)
            value = felt + inertia * (1 + mass)
            std = noise * abs(true)
            value += complex(*(std * random.standard_normal(2)))

            def delayed(delay: float, value: complex = value, omega: float = omega, add: float = inertia) -> complex:
                return complex((value - add) * np.exp(1j * omega * delay) + add)

            shifts = {"radius": value * RADIUS / 2, "poisson": value * NU, "mass": complex(MASS * inertia)}
            found.append(
                ModulusLine(
                    f"run{k}", frequency, 1e-3, 4e-3, 1e-6, 0.5, value, std, 80.0, shifts, 1j * omega * value, delayed
                )
            )
    return found


def covered(draws: int, recordings: int, scatter: float, sines: int, seed: int = 0) -> np.ndarray:
    """How many draws hold E, eta and E within the range of the recordings; and the mean of their errors over u."""
    counts, errors = np.zeros(3), np.zeros(2)
    for draw in range(draws):
        lines = drawn_lines(np.random.default_rng([seed, recordings, sines, draw]), recordings, scatter, sines)
        solid = fit_law(LAWS[0], lines)
        assert solid is not None
        score = (solid.values - [E, ETA]) / solid.stds
        counts[:2] += np.abs(score) < 1.96
        errors += score
        young = [line.young.real for line in lines]
        counts[2] += min(young) <= solid.values[0] <= max(young)
    return np.array([*counts, *(errors / draws)])


def main() -> None:
    """Print the counts."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("draws", type=int, nargs="?", default=400)
    draws = parser.parse_args().draws
    print("recordings  sines  scatter %    E in 95 %  eta in 95 %  E in the range   mean error/u of E, eta")
    for recordings, sines in ((3, 3), (4, 2), (8, 1), (8, 3)):
        for scatter in (0.0, 0.005, 0.02, 0.08):
            *counts, first, second = covered(draws, recordings, scatter, sines)
            within = "  ".join(f"{100 * count / draws:10.1f}" for count in counts)
            print(f"{recordings:10}{sines:7}{100 * scatter:11.1f}  {within}  {first:+.2f} {second:+.2f}", flush=True)


if __name__ == "__main__":
    main()
