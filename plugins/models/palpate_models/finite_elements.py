"""Finite elements of a soft cylinder under a rigid tip: axisymmetric, neo-Hookean, nearly incompressible."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from palpate import ConfigurationError, Floats

_MODULUS = 1.0  # Young's modulus; forces are per it
_BULK = 1e5  # of the modulus: Poisson's ratio 0.499998
_STIFF = 3e3  # of the contact, over modulus and contact radius
_GROWTH = 1.25  # of the elements away from the contact
_STEPS = 40  # of Newton's method
_DONE = 1e-6  # of the contact
_HALVINGS = 6


@dataclass(frozen=True)
class Cylinder:
    """A specimen on a rigid base."""

    diameter: float  # [m]
    height: float  # [m]
    bonded: bool = True  # to its base; else it slides


@dataclass(frozen=True)
class Profile:
    """A rigid tip: height f(r) [m] over its lowest point, and its derivative, on arrays of radii (n,) [m]."""

    height: Callable[[Floats], Floats]
    slope: Callable[[Floats], Floats]
    reach: float  # [m] radius out to which it may touch
    sticking: bool = False  # the surface does not slide on it


class SoftCylinder:
    """The elements of one specimen; displacements of order 2 and pressures of order 1 on triangles (Taylor-Hood).

    Energy density E/6 (I_1 - 3 - 2 ln J) + p (J - 1) - p^2/(2 k), large deformations, from the reference. Contact by a
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
        down = cylinder.height - _graded(min(reach, cylinder.height), cylinder.height, max(fine // 2, 4))[::-1]
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
        self._x = np.zeros(self._moves.N + self._presses.N)

    def press(self, tip: Profile, depth: float) -> float:
        """Force over Young's modulus [m^2] at a depth [m], from the state of the depth before; raises RuntimeError."""
        fixed = self._held()
        free = np.setdiff1d(np.arange(len(self._x)), fixed)
        x, (matrix, residual, force) = self._x.copy(), self._system(self._x, tip, depth)
        for _ in range(_STEPS):
            change = self._solve(matrix, -residual, fixed, np.zeros(len(x)))
            length = float(np.max(np.abs(change[: self._moves.N])))
            share = min(1.0, 0.5 * self._scale / max(length, 1e-300))
            before = float(np.linalg.norm(residual[free]))
            for _ in range(_HALVINGS):  # where the contact's edge jumps, a whole step leads back and forth
                tried = x + share * change
                matrix, residual, force = self._system(tried, tip, depth)
                if float(np.linalg.norm(residual[free])) < before or length < _DONE * self._scale:
                    break
                share *= 0.5
            x = tried
            if length < _DONE * self._scale:
                self._x = x
                return force
        raise RuntimeError(f"finite elements: no equilibrium was found at a depth of {1e3 * depth:.3g} mm")

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
            matrix, residual, _ = self._system(x, None, 0.0)
            change = self._solve(matrix, -residual, fixed, (target - x) if step == 0 else np.zeros(len(x)))
            x = x + change
            if step and float(np.max(np.abs(change[: self._moves.N]))) < _DONE * self._scale:
                self._x = x
                residual = self._system(x, None, 0.0)[1]
                return -2 * math.pi * float(residual[_second_component(self._moves, "top")].sum())
        raise RuntimeError(f"finite elements: no equilibrium was found at a strain of {strain:.3g}")

    def _held(self) -> Any:
        axis = _first_component(self._moves, "axis")
        base = self._moves.get_dofs("base").all() if self._cylinder.bonded else _second_component(self._moves, "base")
        return np.unique(np.concatenate([axis, base]))

    def _solve(self, matrix: Any, right: Floats, fixed: Any, known: Floats) -> Floats:
        return np.asarray(self._fem.solve(*self._fem.condense(matrix, right, x=known, D=fixed)))

    def _system(self, x: Floats, tip: Profile | None, depth: float) -> tuple[Any, Floats, float]:
        """Tangent, residual and force, all over 2 pi but the force."""
        from scipy.sparse import bmat

        fem, count = self._fem, self._moves.N
        given = {"u": self._moves.interpolate(x[:count]), "p": self._presses.interpolate(x[count:])}
        stiffness = fem.BilinearForm(_stiffness).assemble(self._moves, **given)
        coupling = fem.BilinearForm(_coupling).assemble(self._presses, self._moves, **given)
        softness = fem.BilinearForm(_softness).assemble(self._presses)
        forces = fem.LinearForm(_stress).assemble(self._moves, **given)
        volumes = fem.LinearForm(_volume).assemble(self._presses, **given)
        force = 0.0
        if tip is not None:
            at = {"u": self._top.interpolate(x[:count])}
            stiff = _STIFF * _MODULUS / self._scale
            gap = _Overlap(tip, depth, self._cylinder.height, stiff)
            stiffness = stiffness + fem.BilinearForm(gap.tangent).assemble(self._top, **at)
            forces = forces + fem.LinearForm(gap.traction).assemble(self._top, **at)
            force = 2 * math.pi * float(fem.Functional(gap.force).assemble(self._top, **at))
        matrix = bmat([[stiffness, coupling], [coupling.T, softness]], "csr")
        return matrix, np.concatenate([forces, volumes]), force


@dataclass(frozen=True)
class _Overlap:
    """The energy k/2 <overlap>^2 of a surface in a tip, overlap along the axis; its derivatives are the traction."""

    tip: Profile
    depth: float
    height: float
    stiff: float

    def _at(self, w: Any) -> tuple[Any, Any, Any]:
        place = w.x[0] + w.u[0]
        overlap = w.u[1] + self.depth - self.tip.height(place)
        return np.maximum(overlap, 0.0), overlap > 0, self.tip.slope(place)

    def force(self, w: Any) -> Any:
        return self.stiff * self._at(w)[0] * w.x[0]

    def traction(self, v: Any, w: Any) -> Any:
        overlap, touching, slope = self._at(w)
        found = self.stiff * overlap * (v[1] - slope * v[0])
        return (found + (self.stiff * touching * w.u[0] * v[0] if self.tip.sticking else 0.0)) * w.x[0]

    def tangent(self, u: Any, v: Any, w: Any) -> Any:
        overlap, touching, slope = self._at(w)
        place, step = w.x[0] + w.u[0], 1e-4 * self.tip.reach
        bend = (self.tip.slope(place + step) - self.tip.slope(place - step)) / (2 * step)
        found = touching * (u[1] - slope * u[0]) * (v[1] - slope * v[0]) - overlap * bend * u[0] * v[0]
        if self.tip.sticking:
            found = found + touching * u[0] * v[0]
        return self.stiff * found * w.x[0]


def _gradient(u: Any, r: Any) -> Any:
    """(3, 3, ...) gradient of an axisymmetric displacement: r, z and around."""
    found = np.zeros((3, 3, *u.grad.shape[2:]))
    for i in range(2):
        for j in range(2):
            found[i, j] = u.grad[i, j]
    found[2, 2] = u[0] / r
    return found


def _deformed(w: Any) -> tuple[Any, Any, Any]:
    """F^-T, J and F of the present displacement; 3 by 3 with a block of 2, in closed form."""
    F = _gradient(w.u, w.x[0])
    for i in range(3):
        F[i, i] += 1.0
    plane = F[0, 0] * F[1, 1] - F[0, 1] * F[1, 0]
    inverse = np.zeros_like(F)
    inverse[0, 0], inverse[1, 1] = F[1, 1] / plane, F[0, 0] / plane
    inverse[0, 1], inverse[1, 0] = -F[1, 0] / plane, -F[0, 1] / plane
    inverse[2, 2] = 1.0 / F[2, 2]
    return inverse, plane * F[2, 2], F


def _inner(a: Any, b: Any) -> Any:
    return np.einsum("ij...,ij...", a, b)


def _stress(v: Any, w: Any) -> Any:
    inverse, volume, F = _deformed(w)
    stress = _MODULUS / 3 * (F - inverse) + w.p * volume * inverse
    return _inner(stress, _gradient(v, w.x[0])) * w.x[0]


def _stiffness(u: Any, v: Any, w: Any) -> Any:
    inverse, volume, _ = _deformed(w)
    du, dv = _gradient(u, w.x[0]), _gradient(v, w.x[0])
    turned = np.einsum("ij...,kj...,kl...->il...", inverse, du, inverse)
    found = _MODULUS / 3 * (_inner(du, dv) + _inner(turned, dv))
    found = found + w.p * volume * (_inner(inverse, du) * _inner(inverse, dv) - _inner(turned, dv))
    return found * w.x[0]


def _coupling(p: Any, v: Any, w: Any) -> Any:
    inverse, volume, _ = _deformed(w)
    return p * volume * _inner(inverse, _gradient(v, w.x[0])) * w.x[0]


def _softness(p: Any, q: Any, w: Any) -> Any:
    return -p * q / (_BULK * _MODULUS) * w.x[0]


def _volume(q: Any, w: Any) -> Any:
    return q * (_deformed(w)[1] - 1.0 - w.p / (_BULK * _MODULUS)) * w.x[0]


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


def pressed(cylinder: Cylinder, tip: Profile, depths: Floats, fine: int = 24) -> Iterator[float]:
    """Force over Young's modulus [m^2] at rising depths (n,) [m]."""
    soft = SoftCylinder(cylinder, min(tip.reach, cylinder.diameter / 2), fine)
    for depth in depths.tolist():
        yield soft.press(tip, depth)
