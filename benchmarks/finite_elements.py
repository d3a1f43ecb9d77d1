"""Finite elements against what is known in closed form: Hertz, thin layers, large strain, compression between plates.

Run it with: python benchmarks/finite_elements.py [--quick]
"""

from __future__ import annotations

import math
import sys
import time
from dataclasses import replace

import numpy as np
from palpate import Floats
from palpate_models import Flat, Fung, Sphere
from palpate_models.finite_elements import Cylinder, SoftCylinder, press_cylinder
from palpate_models.rigid_tip import TipProfile
from palpate_models.thickness import Thickness
from palpate_models.two_layers import layer_share

R = 5e-3  # [m]
RATIOS = (0.1, 0.2, 0.3, 0.5, 1.0)  # of contact radius and height


def paraboloid(reach: float) -> TipProfile:
    """z = r^2/(2 R)."""
    return TipProfile(lambda r: r * r / (2 * R), lambda r: r / R, reach)


def hertz(depth: float) -> float:
    """Force over modulus [m^2] of an incompressible half-space."""
    return 16 / 9 * math.sqrt(R) * depth**1.5


def half_space(fine: int) -> None:
    """A block of a thousand contact radii."""
    depth = 2e-5
    a = math.sqrt(R * depth)
    found = next(press_cylinder(Cylinder(2000 * a, 1000 * a), paraboloid(1.5 * a), np.array([depth]), fine))
    print(f"Hertz, {fine} elements: {found / hertz(depth) - 1:+.2%}")


def layers(fine: int) -> None:
    """A wide layer, bonded and sliding, under a sphere that slides and one that sticks; against the laws."""
    depth = 1e-5
    a = math.sqrt(R * depth)
    for bonded, sticking in ((True, False), (False, False), (True, True)):
        tip = replace(paraboloid(1.5 * a), sticking=sticking)
        deep = force(Cylinder(2000 * a, 1000 * a, bonded), tip, depth, fine)
        for x in RATIOS:
            found = force(Cylinder(400 * a, a / x, bonded), tip, depth, fine) / deep
            names = ("dimitriadis", "garcia") if bonded else ("dimitriadis",)
            laws = {n: Thickness(law=n, height=a / x, bonded=bonded).factor(Sphere(radius=R), depth)[0] for n in names}
            kind = f"{'bonded' if bonded else 'sliding'}{', sticking tip' if sticking else ''}"
            print(f"sphere, {kind}, X = {x}: {told(found, laws)}", flush=True)


def flats(fine: int) -> None:
    """A flat tip whose edge is rounded, on a wide bonded layer; X by the radius that its half-space shows."""
    depth, edge = 1e-2 * R, 0.1 * R

    def height(r: Floats) -> Floats:
        return np.maximum(np.abs(r) - (R - edge), 0.0) ** 2 / (2 * edge)

    def slope(r: Floats) -> Floats:
        return np.sign(r) * np.maximum(np.abs(r) - (R - edge), 0.0) / edge

    tip = TipProfile(height, slope, 1.2 * R)
    deep = force(Cylinder(2000 * R, 1000 * R), tip, depth, fine)
    radius = deep / (8 / 3 * depth)
    print(f"flat: acts as one of {radius / R:.3f} R on a half-space")
    for x in RATIOS:
        found = force(Cylinder(400 * R, radius / x), tip, depth, fine) / deep
        law = Thickness(law="garcia", height=radius / x).factor(Flat(radius=radius), depth)[0]
        print(f"flat, bonded, X = {x}: {told(found, {'garcia': law})}", flush=True)


def force(cylinder: Cylinder, tip: TipProfile, depth: float, fine: int) -> float:
    """Force over modulus [m^2] at a depth [m]."""
    return next(press_cylinder(cylinder, tip, np.array([depth]), fine))


def told(found: float, laws: dict[str, float]) -> str:
    """A factor against the laws', and which of these it is nearer to."""
    sides = ", ".join(f"{name} {law:.4f} ({found / law - 1:+.1%})" for name, law in laws.items())
    nearest = min(laws, key=lambda name: abs(found - laws[name]))
    return f"{found:.4f}; {sides}{f'; nearer to {nearest}' if len(laws) > 1 else ''}"


def stiffening(fine: int) -> None:
    """Fung's material under a sphere as it is, on a half-space; against the model `fung`."""
    steep = 0.98 * R

    def height(r: Floats) -> Floats:
        inner = np.minimum(np.abs(r), steep)
        return R - np.sqrt(R**2 - inner**2) + (np.abs(r) - inner) * steep / math.sqrt(R**2 - steep**2)

    def slope(r: Floats) -> Floats:
        inner = np.minimum(np.abs(r), steep)
        return np.sign(r) * inner / np.sqrt(R**2 - inner**2)

    tip, depths = TipProfile(height, slope, 0.95 * R), R * np.array([0.2, 0.4, 0.6, 0.8])
    for b in (0.0, 4.0, 10.0):
        for depth, area in zip(depths, press_cylinder(Cylinder(40 * R, 20 * R, stiffening=b), tip, depths, fine // 2)):
            law = Fung(indenter=Sphere(radius=R)).force(depth, 0.0, (1.0, 0.0, b)) / hertz(depth)
            print(f"Fung, b = {b:g}, d = {depth / R:.1f} R: {told(area / hertz(depth), {'fung': law})}", flush=True)


def skins(fine: int) -> None:
    """A layer on a half-space, at small strain; against the model `two-layers`."""
    depth = 1e-5
    a = math.sqrt(R * depth)
    deep = force(Cylinder(400 * a, 200 * a), paraboloid(1.6 * a), depth, fine // 2)
    for ratio in (10.0, 5.0, 0.2):
        for x in (0.2, 0.5, 1.0):
            cylinder = Cylinder(400 * a, 200 * a, skin=a / x, skin_modulus=ratio)
            found = force(cylinder, paraboloid(1.6 * a), depth, fine // 2) / deep
            law = ratio ** float(layer_share(math.log(ratio), x))
            print(f"layer, E_s/E = {ratio:g}, x = {x}: {told(found, {'two-layers': law})}", flush=True)


def plates(fine: int) -> None:
    """1.705 at zero strain for D/H = 2.32."""
    height, diameter = 22e-3, 2.32 * 22e-3
    soft = SoftCylinder(Cylinder(diameter, height), diameter / 2, fine)
    area = math.pi * diameter**2 / 4
    secants = [
        f"{strain:.0%}: {soft.compress(max(strain, 1e-4)) / (max(strain, 1e-4) * area):.4f}" for strain in (0.0, 0.05)
    ]
    print(f"compression factor, {fine} elements: {', '.join(secants)}")


def main() -> None:
    """Everything, with times."""
    for check in (half_space, layers, flats, stiffening, skins, plates):
        began = time.perf_counter()
        for fine in (12,) if "--quick" in sys.argv else (24, 48):
            check(fine)
        print(f"  {time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
