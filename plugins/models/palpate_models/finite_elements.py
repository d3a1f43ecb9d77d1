"""Finite elements of a soft cylinder under a rigid tip: axisymmetric, neo-Hookean, nearly incompressible."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from palpate import ConfigurationError, Floats

from palpate_models import neo_hookean
from palpate_models.rigid_tip import Overlap, TipProfile

_STIFF = 3e3  # of the contact, over modulus and contact radius
_GROWTH = 1.25  # of the elements away from the contact
_STEPS = 40  # of Newton's method between plates
_TRIES = 25  # of Newton's method at one depth, before a smaller step of the depth is taken
_DONE = 1e-6  # of the contact
_HALVINGS = 4  # of one of Newton's steps
_WORSE = 3.0  # by which the residual may pass its worst of late: a whole step is needed where the contact's edge jumps
_LATE = 4  # of Newton's steps
_THINNEST = 0.05  # of an element, over its size at rest
_SMALLEST = 1 / 64  # of the way to the next depth: less, and no equilibrium exists


class NoEquilibriumError(RuntimeError):
    """No equilibrium was found at a depth, or not in the time allowed."""


@dataclass(frozen=True)
class Cylinder:
    """A specimen on a rigid base."""

    diameter: float  # [m]
    height: float  # [m]
    bonded: bool = True  # to its base; else it slides
    stiffening: float = 0.0  # b of Fung's law; 0: neo-Hookean
    skin: float = 0.0  # [m] of a layer on top, bonded to what is below
    skin_modulus: float = 1.0  # of that layer, over the modulus of what is below


class SoftCylinder:
    """The elements of one specimen; displacements of order 2 and pressures of order 1 on triangles (Taylor-Hood).

    Energy density of `neo_hookean`, large deformations, from the reference; E is that below the skin. Contact by a
    penalty on the overlap with the tip in the deformed place, so that traction is normal to the tip: no friction.
    Raises ConfigurationError without scikit-fem.
    """

    def __init__(self, cylinder: Cylinder, reach: float, fine: int = 24) -> None:
        try:
            import skfem
        except ImportError as error:
            raise ConfigurationError("finite elements need scikit-fem: pip install 'palpate[fem]'") from error
        self._fem: Any = skfem
        self._cylinder = cylinder
        radius = cylinder.diameter / 2
        across = _graded(reach, radius, fine)
        depths = _graded(min(reach, cylinder.height), cylinder.height, max(fine // 2, 4))
        if cylinder.skin:  # elements end where the layer does
            depths[np.argmin(np.abs(depths[1:-1] - cylinder.skin)) + 1] = cylinder.skin
        down = cylinder.height - depths[::-1]
        mesh: Any = skfem.MeshTri.init_tensor(across, down)
        mesh = mesh.with_boundaries(
            {
                "axis": lambda x: np.isclose(x[0], 0.0),
                "base": lambda x: np.isclose(x[1], 0.0),
                "top": lambda x: np.isclose(x[1], cylinder.height),
            }
        )
        self._moves = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTriP2()), intorder=5)
        self._presses = self._moves.with_element(skfem.ElementTriP1())
        self._top = skfem.FacetBasis(
            mesh, skfem.ElementVector(skfem.ElementTriP2()), facets=mesh.boundaries["top"], intorder=8
        )
        self._scale = reach
        self._radii, heights = np.asarray(self._moves.global_coordinates())
        on_top = heights > cylinder.height - cylinder.skin
        self._modulus = np.where(on_top, cylinder.skin_modulus, 1.0)
        self._x = np.zeros(self._moves.N + self._presses.N)
        self._states = [(0.0, self._x)]  # the last two equilibria under a tip

    def press(self, tip: TipProfile, depth: float, until: float = math.inf) -> float:
        """Force over Young's modulus [m^2] at a depth [m], by steps from the deepest depth so far.

        Each step begins at the straight line through the two equilibria before it, and is halved where that leads to
        none. Raises NoEquilibriumError, also when the clock `time.monotonic` passes `until` [s].
        """
        whole = step = depth - self._states[-1][0]
        while True:
            reached = self._states[-1][0]
            target = depth if reached + 1.01 * step >= depth else reached + step
            found = self._equilibrium(tip, target, self._ahead(target), until)
            if found is not None:
                self._states = [self._states[-1], (target, found[0])]
                if target == depth:
                    return found[1]
                step *= 1.5
            elif (step := 0.5 * step) < _SMALLEST * whole:
                raise NoEquilibriumError(f"no equilibrium was found at a depth of {1e3 * target:.3g} mm")

    def _ahead(self, depth: float) -> Floats:
        (before, old), (last, new) = self._states[0], self._states[-1]
        return new + (depth - last) / (last - before) * (new - old) if last > before > 0 else new

    def _equilibrium(self, tip: TipProfile, depth: float, x: Floats, until: float) -> tuple[Floats, float] | None:
        """State and force at a depth by Newton's method from a state; None where it does not converge."""
        fixed = self._held()
        free = np.setdiff1d(np.arange(len(x)), fixed)
        residual, force = self._residual(x, tip, depth)
        norms = [float(np.linalg.norm(residual[free]))]
        for _ in range(_TRIES):
            if time.monotonic() > until:
                raise NoEquilibriumError(f"the time limit was reached on the way to a depth of {1e3 * depth:.3g} mm")
            change = self._solve(self._tangent(x, tip, depth), -residual, fixed, np.zeros(len(x)))
            length = float(np.max(np.abs(change[: self._moves.N])))
            if not math.isfinite(length):
                return None
            done = length < _DONE * self._scale
            share = min(1.0, 0.5 * self._scale / max(length, 1e-300))
            for halving in range(_HALVINGS + 1):
                tried = x + 0.5**halving * share * change
                residual, force = self._residual(tried, tip, depth)
                norm = float(np.linalg.norm(residual[free])) if self._whole(tried) else math.inf
                if norm < _WORSE * max(norms[-_LATE:]) or (done and norm < math.inf):
                    break
            else:
                return None
            x = tried
            norms.append(norm)
            if done:
                return x, force
        return None

    def compress(self, strain: float) -> float:
        """Force over modulus [m^2] between plates that hold both faces, at a strain; from the state before."""
        fixed = np.unique(np.concatenate([self._held(), self._moves.get_dofs("top").all()]))
        target = self._x.copy()
        target[self._moves.get_dofs("top").all(["u^1"])] = 0.0
        vertical = self._moves.get_dofs("top").all()
        names = np.isin(vertical, _second_component(self._moves, "top"))
        target[vertical] = np.where(names, -strain * self._cylinder.height, 0.0)
        x = self._x.copy()
        for step in range(_STEPS):
            residual, matrix = self._residual(x, None, 0.0)[0], self._tangent(x, None, 0.0)
            change = self._solve(matrix, -residual, fixed, (target - x) if step == 0 else np.zeros(len(x)))
            x = x + change
            if step and float(np.max(np.abs(change[: self._moves.N]))) < _DONE * self._scale:
                self._x = x
                residual = self._residual(x, None, 0.0)[0]
                return -2 * math.pi * float(residual[_second_component(self._moves, "top")].sum())
        raise NoEquilibriumError(f"no equilibrium was found at a strain of {strain:.3g}")

    def _held(self) -> Any:
        axis = _first_component(self._moves, "axis")
        base = self._moves.get_dofs("base").all() if self._cylinder.bonded else _second_component(self._moves, "base")
        return np.unique(np.concatenate([axis, base]))

    def _solve(self, matrix: Any, right: Floats, fixed: Any, known: Floats) -> Floats:
        return np.asarray(self._fem.solve(*self._fem.condense(matrix, right, x=known, D=fixed)))

    def _given(self, x: Floats) -> dict[str, Any]:
        count = self._moves.N
        material = {"b": self._cylinder.stiffening, "modulus": self._modulus}
        return {"u": self._moves.interpolate(x[:count]), "p": self._presses.interpolate(x[count:])} | material

    def _overlap(self, tip: TipProfile, depth: float) -> Overlap:
        return Overlap(tip, depth, _STIFF * neo_hookean.MODULUS / self._scale)

    def _whole(self, x: Floats) -> bool:
        """Whether no element is turned over, along the surface or around the axis."""
        F = neo_hookean.gradient(self._moves.interpolate(x[: self._moves.N]), self._radii)
        plane = (1 + F[0, 0]) * (1 + F[1, 1]) - F[0, 1] * F[1, 0]
        return bool(min(plane.min(), 1 + F[2, 2].min()) > _THINNEST)

    def _tangent(self, x: Floats, tip: TipProfile | None, depth: float) -> Any:
        """The residual's derivative, over 2 pi."""
        from scipy.sparse import bmat

        fem, given = self._fem, self._given(x)
        stiffness = fem.BilinearForm(neo_hookean.stiffness).assemble(self._moves, **given)
        coupling = fem.BilinearForm(neo_hookean.coupling).assemble(self._presses, self._moves, **given)
        softness = fem.BilinearForm(neo_hookean.softness).assemble(self._presses)
        if tip is not None:
            at = {"u": self._top.interpolate(x[: self._moves.N])}
            stiffness = stiffness + fem.BilinearForm(self._overlap(tip, depth).tangent).assemble(self._top, **at)
        return bmat([[stiffness, coupling], [coupling.T, softness]], "csr")

    def _residual(self, x: Floats, tip: TipProfile | None, depth: float) -> tuple[Floats, float]:
        """What is out of balance, over 2 pi, and the force of the tip."""
        fem, given, force = self._fem, self._given(x), 0.0
        forces = fem.LinearForm(neo_hookean.stress).assemble(self._moves, **given)
        volumes = fem.LinearForm(neo_hookean.volume).assemble(self._presses, **given)
        if tip is not None:
            at = {"u": self._top.interpolate(x[: self._moves.N])}
            overlap = self._overlap(tip, depth)
            forces = forces + fem.LinearForm(overlap.traction).assemble(self._top, **at)
            force = 2 * math.pi * float(fem.Functional(overlap.force).assemble(self._top, **at))
        return np.concatenate([forces, volumes]), force


def _first_component(basis: Any, boundary: str) -> Any:
    dofs = basis.get_dofs(boundary)
    return np.unique(np.concatenate([dofs.all([name]) for name in basis.elem.dofnames if name.endswith("^1")]))


def _second_component(basis: Any, boundary: str) -> Any:
    dofs = basis.get_dofs(boundary)
    return np.unique(np.concatenate([dofs.all([name]) for name in basis.elem.dofnames if name.endswith("^2")]))


def _graded(fine: float, whole: float, count: int) -> Floats:
    """Edges from 0: equal ones out to `fine`, then ever larger ones out to the `whole`."""
    edges = list(np.linspace(0.0, min(fine, whole), count + 1))
    step = edges[1] - edges[0]
    while edges[-1] < whole - 1e-12:
        step *= _GROWTH
        edges.append(min(edges[-1] + step, whole))
        if whole - edges[-1] < 0.5 * step:
            edges[-1] = whole
    return np.array(edges)


def press_cylinder(
    cylinder: Cylinder,
    tip: TipProfile | Callable[[float], TipProfile],
    depths: Floats,
    fine: int = 24,
    until: float = math.inf,
) -> Iterator[float]:
    """Force over Young's modulus [m^2] at rising depths (n,) [m]; raises NoEquilibriumError, also past `until` [s].

    A function gives the tip at a depth [m].
    """
    at = tip if callable(tip) else lambda _: tip
    soft = SoftCylinder(cylinder, min(at(float(depths[-1])).reach, cylinder.diameter / 2), fine)
    for depth in depths.tolist():
        yield soft.press(at(depth), depth, until)
