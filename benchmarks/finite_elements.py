"""Finite elements against what is known in closed form: Hertz, thin layers, large strain, compression between plates.

Run it with: python benchmarks/finite_elements.py [--quick]
"""

from __future__ import annotations

import math
import sys
import time

import numpy as np
from palpate_models import Sphere
from palpate_models.finite_elements import Cylinder, Profile, SoftCylinder, pressed
from palpate_models.thickness import Thickness

R = 5e-3  # [m]


def paraboloid(reach: float) -> Profile:
    """z = r^2/(2 R)."""
    return Profile(lambda r: r * r / (2 * R), lambda r: r / R, reach)


def hertz(depth: float) -> float:
    """Force over modulus [m^2] of an incompressible half-space."""
    return 16 / 9 * math.sqrt(R) * depth**1.5


def half_space(fine: int) -> None:
    """A block of a thousand contact radii."""
    depth = 2e-5
    a = math.sqrt(R * depth)
    found = next(pressed(Cylinder(2000 * a, 1000 * a), paraboloid(1.5 * a), np.array([depth]), fine))
    print(f"Hertz, {fine} elements: {found / hertz(depth) - 1:+.2%}")


def layers(fine: int) -> None:
    """A wide bonded layer, against Dimitriadis and Garcia."""
    depth = 1e-5
    a = math.sqrt(R * depth)
    for x in (0.1, 0.2, 0.3, 0.5, 1.0):
        height = a / x
        found = next(pressed(Cylinder(400 * a, height), paraboloid(1.5 * a), np.array([depth]), fine)) / hertz(depth)
        laws = [
            Thickness(law=law, height=height).factor(Sphere(radius=R), depth)[0] for law in ("dimitriadis", "garcia")
        ]
        near = "dimitriadis" if abs(found - laws[0]) < abs(found - laws[1]) else "garcia"
        told = ", ".join(
            f"{name} {law:.4f} ({found / law - 1:+.1%})" for name, law in zip(("D", "G"), laws, strict=True)
        )
        print(f"layer X = {x}: {found:.4f}; {told}; nearer to {near}")


def plates(fine: int) -> None:
    """1.705 at zero strain for D/H = 2.32."""
    height, diameter = 22e-3, 2.32 * 22e-3
    soft = SoftCylinder(Cylinder(diameter, height), diameter / 2, fine)
    area = math.pi * diameter**2 / 4
    told = [
        f"{strain:.0%}: {soft.compress(max(strain, 1e-4)) / (max(strain, 1e-4) * area):.4f}" for strain in (0.0, 0.05)
    ]
    print(f"compression factor, {fine} elements: {', '.join(told)}")


def main() -> None:
    """Everything, with times."""
    for check in (half_space, layers, plates):
        began = time.perf_counter()
        for fine in (12,) if "--quick" in sys.argv else (24, 48):
            check(fine)
        print(f"  {time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
