"""Laws of linear materials, each as one expression E*(s): moduli over frequency and time, and creep, follow from it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

Complexes = NDArray[np.complex128]
_NODES = 24  # of Talbot's contour; its error is some 1e-11 of the largest value
_TALBOT = 0.4  # r t over the number of nodes, 2/5 (Abate and Valko 2004)
_MAX_POWER = 0.99  # of a springpot: Gamma(1 - alpha) is infinite at 1


@dataclass(frozen=True)
class LinearLaw:
    """Law of a linear material: the modulus that it has for motion as exp(s t).

    Parameters have the names and meanings of the contact model of the same material, by which the same law is fitted to
    palpations.
    """

    name: str
    formula: str
    parameters: tuple[tuple[str, str], ...]  # name and SI unit
    modulus: Callable[[Complexes, Sequence[Any], float], Any]  # E*(s) [Pa] of s [1/s], parameters, Poisson's ratio
    starts: Callable[[float, Floats], list[list[float]]]  # from a level [Pa] and times (n,) [s] of the data
    upper: tuple[float, ...] = ()  # of the parameters; infinite where left out
    times: tuple[float, ...] = ()  # relaxation times [s] of arms that are not parameters

    def complex_modulus(self, frequency: Floats, values: Sequence[float], poisson: float) -> Complexes:
        """Return E' + i E'' (n,) [Pa] at frequencies (n,) [Hz]."""
        s = (2j * np.pi * frequency).astype(np.complex128)
        return np.asarray(self.modulus(s, values, poisson), np.complex128)

    def shear_modulus(self, omega: Floats, values: Sequence[float] | Floats, poisson: float) -> Complexes:
        """Return G' + i G'' (n,) [Pa] at angular frequencies (n,) [rad/s]."""
        return self.complex_modulus(omega / (2.0 * np.pi), list(values), poisson) / (2.0 * (1.0 + poisson))

    @property
    def uppers(self) -> tuple[float, ...]:
        """Upper bounds of all parameters."""
        return (*self.upper, *[math.inf] * (len(self.parameters) - len(self.upper)))

    def relaxation(self, time: Floats, values: Sequence[float], poisson: float) -> Floats:
        """Return E(t) (n,) [Pa] at times (n,) [s] after a step of the strain: the inverse Laplace transform of
        E*(s)/s."""
        return inverse_laplace(lambda s: self.modulus(s, values, poisson) / s, time)

    def creep(self, time: Floats, values: Sequence[float], poisson: float) -> Floats:
        """Return D(t) (n,) [1/Pa] at times (n,) [s] after a step of the stress: the inverse Laplace transform of 1/(s
        E*)."""
        return inverse_laplace(lambda s: 1.0 / (s * self.modulus(s, values, poisson)), time)


def inverse_laplace(transform: Callable[[Complexes], Any], time: Floats) -> Floats:
    """Return f(t) (n,) at t (n,) > 0, of a transform whose singularities are on the negative real axis.

    Talbot's contour with fixed nodes: f(t) = r/M sum of Re(g_k F(s_k)), s_k = r a_k (cot a_k + i), a_k = k pi/M, r = 2
    M/(5 t). Source: Abate and Valko 2004.
    """
    turn, weight = _contour()
    s = turn[None, :] / time[:, None]
    return np.asarray((transform(s) * weight[None, :]).real.sum(axis=1) * _TALBOT / time)


@cache
def _contour() -> tuple[Complexes, Complexes]:
    """Return s t at the nodes (m,) of Talbot's contour, and their weights (m,); the first node, s = r, counts half."""
    angle = np.arange(1, _NODES) * math.pi / _NODES
    cot = 1.0 / np.tan(angle)
    turn = _TALBOT * angle * (cot + 1j) * _NODES
    weight = (1.0 + 1j * angle * (1.0 + cot**2) - 1j * cot) * np.exp(turn)
    first = _TALBOT * _NODES
    return np.concatenate([[first], turn]), np.concatenate([[0.5 * math.exp(first)], weight])


def _viscous(poisson: float) -> float:
    """Return Young's over shear modulus: the factor from a shear viscosity to that of tension."""
    return 2.0 * (1.0 + poisson)


def _branches(s: Complexes, p: Sequence[Any], _: float) -> Any:
    return p[0] + arm_moduli(s, p[1::2], p[2::2])


def arm_moduli(s: Complexes, strengths: Sequence[Any], times: Sequence[Any]) -> Any:
    """Return what Maxwell arms in parallel add to E*(s) [Pa]."""
    return sum(strength * s * tau / (1.0 + s * tau) for strength, tau in zip(strengths, times, strict=True))


def _maxwell(s: Complexes, p: Sequence[Any], poisson: float) -> Any:
    flow = s * _viscous(poisson) * p[1]
    return p[0] * flow / (p[0] + flow)


def _burgers(s: Complexes, p: Sequence[Any], poisson: float) -> Any:
    per = _viscous(poisson)
    return 1.0 / (1.0 / p[0] + 1.0 / (s * per * p[1]) + 1.0 / (p[2] + s * per * p[3]))


def _springpot(s: Complexes, strength: Any, power: Any) -> Any:
    """Return Gamma(1 - alpha) E s^alpha, of which E (t/1 s)^-alpha is the relaxation modulus."""
    return math.gamma(1.0 - power) * strength * s**power


def _two_springpots(s: Complexes, p: Sequence[Any], _: float) -> Any:
    """Return the modulus of two springpots V s^alpha and G s^beta in series."""
    slow, fast = p[0] * s ** p[1], p[2] * s ** p[3]
    return slow * fast / (slow + fast)


def _arm_parameters(count: int) -> tuple[tuple[str, str], ...]:
    pairs = [((f"arm_elasticity_{k}", "Pa"), (f"arm_time_{k}", "s")) for k in range(1, count + 1)]
    return (("elasticity", "Pa"), *(parameter for pair in pairs for parameter in pair))


# Places where a search for parameters begins, relative to the level of the data: choices, which only have to be near.
_EDGES = (0.0, 0.25)  # of the decades of the data, without arms at both ends
_LASTING = (0.5, 0.05)  # of the level that does not relax
_POWERS = (0.05, 0.2, 0.5)  # of a springpot: nearly a spring, tissue, half a dashpot


def _arm_starts(count: int) -> Callable[[float, Floats], list[list[float]]]:
    """Return a function that makes starts for a fit of `count` Maxwell arms, each with a strength and a time.

    Their times are spread evenly over the logarithm of the data's times, and over the inner half of these.
    """

    def starts(level: float, times: Floats) -> list[list[float]]:
        """Return starts by a level and times (n,) [s]: a lasting part, then strength and time of each arm."""
        candidates = []
        low, high = math.log(float(times.min())), math.log(float(times.max()))
        for share in _EDGES:
            edge = share * (high - low)
            taus = np.exp(np.linspace(low + edge, high - edge, count + 2)[1:-1]).tolist()
            for lasting in _LASTING:
                strength = 2.0 * (1.0 - lasting) * level / count  # at the shortest times some twice the level
                arms = [number for tau in taus for number in (strength, tau)]
                candidates.append([lasting * level, *arms])
        return candidates

    return starts


def _middle(times: Floats) -> float:
    """Return the geometric mean of the first and the last time [s]."""
    return math.sqrt(float(times.min()) * float(times.max()))


def _at_times(times: Floats) -> tuple[float, float, float]:
    """Return first, middle and last time [s], at which searches begin."""
    return float(times.min()), _middle(times), float(times.max())


LAWS = (
    LinearLaw(
        "kelvin-voigt", "E* = E + 2 (1 + nu) eta s", (("elasticity", "Pa"), ("viscosity", "Pa*s")),
        lambda s, p, nu: p[0] + s * _viscous(nu) * p[1],
        lambda level, times: [[level, 0.1 * level * tau] for tau in _at_times(times)],
    ),
    LinearLaw(
        "maxwell", "E* = E s tau/(1 + s tau), tau = 2 (1 + nu) eta/E", (("elasticity", "Pa"), ("viscosity", "Pa*s")),
        _maxwell, lambda level, times: [[2 * level, level * tau] for tau in _at_times(times)],
    ),
    LinearLaw(
        "standard-linear-solid", "E* = E + E_1 s tau/(1 + s tau)",
        (("elasticity", "Pa"), ("relaxing_elasticity", "Pa"), ("relaxation_time", "s")), _branches,
        lambda level, times: [[share * level, level, tau] for tau in _at_times(times) for share in (0.7, 0.1)],
    ),
    *(
        LinearLaw(
            f"generalised-maxwell-{count}", "E* = E + sum of E_k s tau_k/(1 + s tau_k)", _arm_parameters(count),
            _branches, _arm_starts(count),
        )
        for count in (2, 3, 4)
    ),
    LinearLaw(
        "burgers", "1/E* = 1/E + 1/(n s) + 1/(E_K + n_K s), n = 2 (1 + nu) eta",
        (("elasticity", "Pa"), ("viscosity", "Pa*s"), ("delayed_elasticity", "Pa"), ("delayed_viscosity", "Pa*s")),
        _burgers,
        lambda level, times: [
            [2 * level, share * level * float(times.max()), level, 0.3 * level * tau]
            for tau in _at_times(times) for share in (0.3, 10.0)
        ],
    ),
    LinearLaw(
        "power-law", "E(t) = E (t/1 s)^-alpha", (("elasticity", "Pa"), ("power", "1")),
        lambda s, p, nu: _springpot(s, *p),
        lambda level, times: [[level * _middle(times) ** power, power] for power in _POWERS],
        (math.inf, _MAX_POWER),
    ),
    LinearLaw(
        "fractional-kelvin-voigt", "E(t) = E + E_f (t/1 s)^-alpha",
        (("elasticity", "Pa"), ("fading_elasticity", "Pa"), ("power", "1")),
        lambda s, p, nu: p[0] + _springpot(s, p[1], p[2]),
        lambda level, times: [
            [share * level, 0.5 * level * _middle(times) ** power, power] for power in _POWERS for share in (0.7, 0.1)
        ],
        (math.inf, math.inf, _MAX_POWER),
    ),
    LinearLaw(
        "fractional-maxwell", "1/E* = 1/(V s^alpha) + 1/(W s^beta)",
        (("slow_strength", "Pa*s^alpha"), ("slow_power", "1"), ("fast_strength", "Pa*s^beta"), ("fast_power", "1")),
        _two_springpots,
        lambda level, times: [
            [2 * level * tau**slow, slow, 2 * level * tau**fast, fast]
            for tau in _at_times(times) for slow, fast in ((0.7, 0.1), (0.95, 0.02), (0.4, 0.2))
        ],
        (math.inf, 1.0, math.inf, _MAX_POWER),
    ),
)  # fmt: skip


def law_of(name: str) -> LinearLaw | None:
    """Return the law of a name, if there is one."""
    return next((law for law in LAWS if law.name == name), None)
