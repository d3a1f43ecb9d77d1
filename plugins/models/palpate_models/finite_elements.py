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

_CONTACT_STIFFNESS = 3e3  # a choice: stiffness of the penalty, over modulus and contact radius
_GRADING = 1.25  # a choice: size of an element over that of its neighbour, away from the contact
_MAX_PLATE_STEPS = 40  # a choice: Newton steps between plates
_MAX_NEWTON_STEPS = 25  # a choice: at one depth, before a smaller step of the depth is taken
_STEP_GROWTH = 1.5  # a choice: of the steps of depth, after each equilibrium
_LAST_STEP = 1.01  # a choice: steps; a remainder up to so much is taken in one step
_TOLERANCE = 1e-6  # of the contact radius, a choice: change of the last Newton step
_MAX_DISPLACEMENT = 0.5  # of the contact radius, a choice: largest change in a Newton step
_MAX_HALVINGS = 4  # a choice: of a Newton step
_MAX_INCREASE = 3.0  # a choice: a residual may exceed its late maximum so far, since the contact's edge jumps
_LATE_STEPS = 4  # a choice: Newton steps of that maximum
_MIN_THICKNESS = 0.05  # of an element, over its size at rest, a choice: a thinner one is turned over
_MIN_STEP_SHARE = 1 / 64  # of the way to the next depth, a choice: with smaller steps no equilibrium exists
_MIN_CHANGE = 1e-300  # a choice: keeps a quotient finite


class NoEquilibriumError(RuntimeError):
    """A depth without an equilibrium, or none in the time allowed."""


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
        """Mesh a cylinder, with `fine` elements over the `reach` [m] of the contact; raises ConfigurationError.

        Displacements are quadratic and pressures linear in each element. The quadrature is exact for polynomials of
        degree 5, and of 8 on the face that touches, where the pressure has an edge: choices, as the 24 elements are.
        """
        try:
            import skfem
        except ImportError as error:
            raise ConfigurationError("finite elements need scikit-fem: pip install 'palpate[fem]'") from error
        self._fem: Any = skfem
        self._cylinder = cylinder
        self._scale = reach
        # Displacements, pressures, and the displacements of the face that touches.
        mesh = self._mesh(cylinder, reach, fine)
        quadratic = skfem.ElementVector(skfem.ElementTriP2())
        self._moves = skfem.Basis(mesh, quadratic, intorder=5)
        self._presses = self._moves.with_element(skfem.ElementTriP1())
        self._top = skfem.FacetBasis(mesh, quadratic, facets=mesh.boundaries["top"], intorder=8)
        # The modulus at each point of the quadrature.
        self._radii, heights = np.asarray(self._moves.global_coordinates())
        is_skin = heights > cylinder.height - cylinder.skin
        self._modulus = np.where(is_skin, cylinder.skin_modulus, 1.0)
        self._x = np.zeros(self._moves.N + self._presses.N)
        self._held = self._held_freedoms()
        self._free = np.setdiff1d(np.arange(len(self._x)), self._held)
        self._states = [(0.0, self._x)]  # the last two equilibria under a tip

    def _mesh(self, cylinder: Cylinder, reach: float, fine: int) -> Any:
        """Return triangles that are `fine` across the contact, and grow away from it."""
        radii = _graded(reach, cylinder.diameter / 2, fine)
        depths = _graded(min(reach, cylinder.height), cylinder.height, max(fine // 2, 4))
        if cylinder.skin:  # elements end where the layer does
            depths[np.argmin(np.abs(depths[1:-1] - cylinder.skin)) + 1] = cylinder.skin
        mesh: Any = self._fem.MeshTri.init_tensor(radii, cylinder.height - depths[::-1])
        return mesh.with_boundaries(
            {
                "axis": lambda x: np.isclose(x[0], 0.0),
                "base": lambda x: np.isclose(x[1], 0.0),
                "top": lambda x: np.isclose(x[1], cylinder.height),
            }
        )

    def press(self, tip: TipProfile, depth: float, until: float = math.inf) -> float:
        """Return the force over Young's modulus [m^2] at a depth [m], by steps from the deepest depth so far.

        Each step starts from the straight line through the two equilibria before it. It is 1.5 times as long as the
        step before; one that leads to no equilibrium is halved. Raises NoEquilibriumError, also when the clock
        `time.monotonic` passes `until` [s].
        """
        distance = step = depth - self._states[-1][0]
        while True:
            reached = self._states[-1][0]  # [m]; a state is a depth and all unknowns there
            # A remainder that is hardly longer than a step is taken in one.
            target = depth if reached + _LAST_STEP * step >= depth else reached + step
            equilibrium = self._equilibrium(tip, target, self._extrapolated(target), until)
            if equilibrium is not None:
                state, force = equilibrium
                self._states = [self._states[-1], (target, state)]
                if target == depth:
                    return force
                step *= _STEP_GROWTH
                continue
            step *= 0.5
            if step < _MIN_STEP_SHARE * distance:
                raise NoEquilibriumError(f"no equilibrium was found at a depth of {1e3 * target:.3g} mm")

    def _extrapolated(self, depth: float) -> Floats:
        """Return the state on the line through the last two equilibria, at a depth [m]."""
        (depth_before, state_before), (last_depth, last_state) = self._states[0], self._states[-1]
        if not last_depth > depth_before > 0:
            return last_state
        return last_state + (depth - last_depth) / (last_depth - depth_before) * (last_state - state_before)

    def _equilibrium(self, tip: TipProfile, depth: float, x: Floats, until: float) -> tuple[Floats, float] | None:
        """Return state and force at a depth by Newton's method from a state; None where it does not converge."""
        residual, force = self._residual(x, tip, depth)
        norms = [self._norm(residual)]
        for _ in range(_MAX_NEWTON_STEPS):
            if time.monotonic() > until:
                raise NoEquilibriumError(f"the time limit was reached on the way to a depth of {1e3 * depth:.3g} mm")
            change = self._solve(self._tangent(x, tip, depth), -residual, np.zeros(len(x)))
            # Of the unknowns the displacements come first, then the pressures.
            length = float(np.max(np.abs(change[: self._moves.N])))
            if not math.isfinite(length):
                return None
            converged = length < _TOLERANCE * self._scale
            # The step is bounded, then halved until the residual is small against those of late.
            share = min(1.0, _MAX_DISPLACEMENT * self._scale / max(length, _MIN_CHANGE))
            for halving in range(_MAX_HALVINGS + 1):
                trial = x + 0.5**halving * share * change
                residual, force = self._residual(trial, tip, depth)
                norm = self._norm(residual) if self._is_whole(trial) else math.inf
                if norm < _MAX_INCREASE * max(norms[-_LATE_STEPS:]) or (converged and norm < math.inf):
                    break
            else:
                return None
            x = trial
            norms.append(norm)
            if converged:
                return x, force
        return None

    def _norm(self, residual: Floats) -> float:
        """Return the length of a residual at the degrees of freedom that are not held."""
        return float(np.linalg.norm(residual[self._free]))

    def compress(self, strain: float) -> float:
        """Return force over modulus [m^2] between plates that hold both faces, at a strain; from the state before."""
        top = self._moves.get_dofs("top").all()
        held = np.unique(np.concatenate([self._held, top]))
        # The upper face moves down as a whole, and not outwards.
        target = self._x.copy()
        target[self._moves.get_dofs("top").all(["u^1"])] = 0.0
        is_vertical = np.isin(top, _second_component(self._moves, "top"))
        target[top] = np.where(is_vertical, -strain * self._cylinder.height, 0.0)
        x = self._x.copy()
        for step in range(_MAX_PLATE_STEPS):
            residual, matrix = self._residual(x, None, 0.0)[0], self._tangent(x, None, 0.0)
            change = self._solve(matrix, -residual, (target - x) if step == 0 else np.zeros(len(x)), held)
            x = x + change
            if step and float(np.max(np.abs(change[: self._moves.N]))) < _TOLERANCE * self._scale:
                self._x = x
                residual = self._residual(x, None, 0.0)[0]
                # The residual is that of one radian about the axis.
                return -2 * math.pi * float(residual[_second_component(self._moves, "top")].sum())
        raise NoEquilibriumError(f"no equilibrium was found at a strain of {strain:.3g}")

    def _held_freedoms(self) -> Any:
        """Return the degrees of freedom that the axis and the base hold."""
        axis = _first_component(self._moves, "axis")
        base = self._moves.get_dofs("base").all() if self._cylinder.bonded else _second_component(self._moves, "base")
        return np.unique(np.concatenate([axis, base]))

    def _solve(self, matrix: Any, right: Floats, prescribed: Floats, held: Any = None) -> Floats:
        """Return the solution of a linear system with prescribed values where the body is held."""
        held = self._held if held is None else held
        return np.asarray(self._fem.solve(*self._fem.condense(matrix, right, x=prescribed, D=held)))

    def _fields(self, x: Floats) -> dict[str, Any]:
        """Return displacement, pressure and material as the weak forms of `neo_hookean` need them."""
        count = self._moves.N
        material = {"b": self._cylinder.stiffening, "modulus": self._modulus}
        return {"u": self._moves.interpolate(x[:count]), "p": self._presses.interpolate(x[count:])} | material

    def _overlap(self, tip: TipProfile, depth: float) -> Overlap:
        return Overlap(tip, depth, _CONTACT_STIFFNESS * neo_hookean.MODULUS / self._scale)

    def _is_whole(self, x: Floats) -> bool:
        """Return True if no element is turned over, along the surface or around the axis."""
        F = neo_hookean.gradient(self._moves.interpolate(x[: self._moves.N]), self._radii)
        plane = (1 + F[0, 0]) * (1 + F[1, 1]) - F[0, 1] * F[1, 0]
        return bool(min(plane.min(), 1 + F[2, 2].min()) > _MIN_THICKNESS)

    def _tangent(self, x: Floats, tip: TipProfile | None, depth: float) -> Any:
        """Return the residual's derivative, over 2 pi."""
        from scipy.sparse import bmat

        fem, fields = self._fem, self._fields(x)
        stiffness = fem.BilinearForm(neo_hookean.stiffness).assemble(self._moves, **fields)
        coupling = fem.BilinearForm(neo_hookean.coupling).assemble(self._presses, self._moves, **fields)
        softness = fem.BilinearForm(neo_hookean.softness).assemble(self._presses)
        if tip is not None:
            face = {"u": self._top.interpolate(x[: self._moves.N])}
            stiffness = stiffness + fem.BilinearForm(self._overlap(tip, depth).tangent).assemble(self._top, **face)
        return bmat([[stiffness, coupling], [coupling.T, softness]], "csr")

    def _residual(self, x: Floats, tip: TipProfile | None, depth: float) -> tuple[Floats, float]:
        """Return the forces out of balance, over 2 pi, and the force of the tip."""
        fem, fields, force = self._fem, self._fields(x), 0.0
        forces = fem.LinearForm(neo_hookean.stress).assemble(self._moves, **fields)
        volumes = fem.LinearForm(neo_hookean.volume).assemble(self._presses, **fields)
        if tip is not None:
            face = {"u": self._top.interpolate(x[: self._moves.N])}
            overlap = self._overlap(tip, depth)
            forces = forces + fem.LinearForm(overlap.traction).assemble(self._top, **face)
            force = 2 * math.pi * float(fem.Functional(overlap.force).assemble(self._top, **face))
        return np.concatenate([forces, volumes]), force


def _first_component(basis: Any, boundary: str) -> Any:
    dofs = basis.get_dofs(boundary)
    return np.unique(np.concatenate([dofs.all([name]) for name in basis.elem.dofnames if name.endswith("^1")]))


def _second_component(basis: Any, boundary: str) -> Any:
    dofs = basis.get_dofs(boundary)
    return np.unique(np.concatenate([dofs.all([name]) for name in basis.elem.dofnames if name.endswith("^2")]))


def _graded(fine: float, length: float, count: int) -> Floats:
    """Return the edges of elements from 0: equal ones out to `fine`, then ever larger ones out to the `length`."""
    edges = list(np.linspace(0.0, min(fine, length), count + 1))
    step = edges[1] - edges[0]
    while edges[-1] < length - 1e-12:  # [m], rounding
        step *= _GRADING
        edges.append(min(edges[-1] + step, length))
        # The last element takes a remainder that is less than half of it.
        if length - edges[-1] < 0.5 * step:
            edges[-1] = length
    return np.array(edges)


def press_cylinder(
    cylinder: Cylinder,
    tip: TipProfile | Callable[[float], TipProfile],
    depths: Floats,
    fine: int = 24,
    until: float = math.inf,
) -> Iterator[float]:
    """Yield the force over Young's modulus [m^2] at rising depths (n,) [m]; raises NoEquilibriumError.

    A function gives the tip at a depth [m]; `fine` elements lie across the contact. The error also says that the clock
    is past `until` [s].
    """
    tip_at = tip if callable(tip) else lambda _: tip
    soft = SoftCylinder(cylinder, min(tip_at(float(depths[-1])).reach, cylinder.diameter / 2), fine)
    for depth in depths.tolist():
        yield soft.press(tip_at(depth), depth, until)
