"""Materials with several relaxation times: generalised Maxwell and Burgers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

from palpate import MaterialValue, Parameter, sqrt

from palpate_models.parameters import FLOW_VISCOSITY, INSTANT_ELASTICITY, LASTING_ELASTICITY
from palpate_models.relaxation_spectrum import RelaxationSpectrum
from palpate_models.relaxing_models import RelaxingModel

_FIRST_TIMES = (0.03, 0.3, 3.0, 30.0)  # [s], a choice: first guesses a decade apart, from the fastest


def _arm(number: int) -> tuple[Parameter, Parameter]:
    """Return strength and time of an arm as parameters."""
    start = _FIRST_TIMES[number - 1]
    return (
        Parameter(
            f"arm_elasticity_{number}", f"E_a{number}", "Pa", f"part of Young's modulus that fades with tau_{number}",
            start=20e3, start_std=50e3,
        ),
        Parameter(
            f"arm_time_{number}", f"tau_{number}", "s", f"time in which E_a{number} falls to 1/e", start=start,
            start_std=start,
        ),
    )  # fmt: skip


class _GeneralisedMaxwell(RelaxingModel):
    """A lasting spring and as many Maxwell arms as the parameters give."""

    def spectrum(self, theta: Sequence[Any]) -> RelaxationSpectrum:
        """E + sum of E_k exp(-t/tau_k)."""
        rates = [1.0 / time for time in theta[2::2]]
        return RelaxationSpectrum(theta[0], None, tuple(zip(theta[1::2], rates, strict=True)))

    def material(self, theta: Sequence[float]) -> tuple[MaterialValue, ...]:
        """E, and E_0 = E + sum of E_k."""
        rest = [1.0] + [0.0] * (len(theta) - 1)
        instant = [1.0] + [1.0, 0.0] * (len(theta) // 2)
        fast = "for motion that is fast against every relaxation time"
        return (
            MaterialValue("elasticity", theta[0], tuple(rest), "at rest"),
            MaterialValue("instant_elasticity", theta[0] + sum(theta[1::2]), tuple(instant), fast),
        )


class GeneralisedMaxwell2(_GeneralisedMaxwell):
    """A lasting spring and two Maxwell arms (Wiechert's), pressed by any axisymmetric tip.

    F = 2 E/(1 - nu^2) A(d) + sum of q_k, dq_k/dt = 2 E_k/(1 - nu^2) a(d) d' - q_k/tau_k in contact and -q_k/tau_k out
    of it: the hereditary integral with E(t) = E + sum of E_k exp(-t/tau_k). One arm is `standard-linear-solid`.
    Assumes what `standard-linear-solid` does. The arms are listed from the fastest. Two times closer than a factor
    of 3, or outside of what the record spans, cannot be distinguished: the fits flag it.
    Source: Lee and Radok 1960; Popov and Hess 2015, chapter on viscoelastic contacts.
    """

    memory: ClassVar[tuple[str, ...]] = ("force_1", "force_2")
    parameters: ClassVar[tuple[Parameter, ...]] = (LASTING_ELASTICITY, *_arm(1), *_arm(2))
    interchangeable: ClassVar[tuple[tuple[int, ...], ...]] = ((1, 2), (3, 4))


class GeneralisedMaxwell3(_GeneralisedMaxwell):
    """A lasting spring and three Maxwell arms, as `generalised-maxwell-2` has two.

    F = 2 E/(1 - nu^2) A(d) + sum of q_k, dq_k/dt = 2 E_k/(1 - nu^2) a(d) d' - q_k/tau_k in contact and -q_k/tau_k out
    of it: the hereditary integral with E(t) = E + sum of E_k exp(-t/tau_k).
    Assumes what `generalised-maxwell-2` does.
    Source: Lee and Radok 1960; Popov and Hess 2015, chapter on viscoelastic contacts.
    """

    memory: ClassVar[tuple[str, ...]] = ("force_1", "force_2", "force_3")
    parameters: ClassVar[tuple[Parameter, ...]] = (LASTING_ELASTICITY, *_arm(1), *_arm(2), *_arm(3))
    interchangeable: ClassVar[tuple[tuple[int, ...], ...]] = ((1, 2), (3, 4), (5, 6))


class GeneralisedMaxwell4(_GeneralisedMaxwell):
    """A lasting spring and four Maxwell arms, as `generalised-maxwell-2` has two.

    F = 2 E/(1 - nu^2) A(d) + sum of q_k, dq_k/dt = 2 E_k/(1 - nu^2) a(d) d' - q_k/tau_k in contact and -q_k/tau_k out
    of it: the hereditary integral with E(t) = E + sum of E_k exp(-t/tau_k).
    Assumes what `generalised-maxwell-2` does; for records over several decades of time.
    Source: Lee and Radok 1960; Popov and Hess 2015, chapter on viscoelastic contacts.
    """

    memory: ClassVar[tuple[str, ...]] = ("force_1", "force_2", "force_3", "force_4")
    parameters: ClassVar[tuple[Parameter, ...]] = (LASTING_ELASTICITY, *_arm(1), *_arm(2), *_arm(3), *_arm(4))
    interchangeable: ClassVar[tuple[tuple[int, ...], ...]] = ((1, 2), (3, 4), (5, 6), (7, 8))


class Burgers(RelaxingModel):
    """A Maxwell element and a Kelvin-Voigt element in series (Burgers'), pressed by any axisymmetric tip.

    F = q_1 + q_2, dq_k/dt = 2 E_k/(1 - nu^2) a(d) d' - q_k/tau_k in contact and -q_k/tau_k out of it. With springs E
    and E_K and dampers n = 2 (1 + nu) eta and n_K = 2 (1 + nu) eta_K, p = n/E + n/E_K + n_K/E_K and
    s = sqrt(p^2 - 4 n n_K/(E E_K)): 1/tau_k = (p -+ s) E E_K/(2 n n_K), E_1 = (n - n n_K/(E_K tau_1))/s and
    E_2 = (n n_K/(E_K tau_2) - n)/s. Held at a depth the force fades to nothing; at a constant force the tip creeps on.
    Assumes what `standard-linear-solid` does. Flow and delayed elasticity are distinguished by records over both times.
    Source: Lee and Radok 1960; Findley, Lai and Onaran 1976, the relaxation modulus of Burgers' model.
    """

    memory: ClassVar[tuple[str, ...]] = ("slow_force", "fast_force")
    parameters: ClassVar[tuple[Parameter, ...]] = (
        INSTANT_ELASTICITY,
        FLOW_VISCOSITY,
        Parameter(
            "delayed_elasticity", "E_K", "Pa", "Young's modulus of the delayed part", start=100e3, start_std=200e3
        ),
        Parameter("delayed_viscosity", "eta_K", "Pa*s", "shear viscosity of the delay", start=3e3, start_std=10e3),
    )

    def spectrum(self, theta: Sequence[Any]) -> RelaxationSpectrum:
        """Return two arms, as in the class, and no lasting modulus."""
        E, flow_viscosity, E_K, delayed_viscosity = theta
        per_viscosity = 2.0 * (1.0 + self.poisson)
        n, n_K = per_viscosity * flow_viscosity, per_viscosity * delayed_viscosity
        # Both rates are roots of a quadratic; the smaller one as a quotient, without a difference.
        p, product = n / E + n / E_K + n_K / E_K, n * n_K / (E * E_K)
        s = sqrt(p * p - 4.0 * product)
        fast_rate = (p + s) / (2.0 * product)
        slow_rate = 2.0 / (p + s)
        weight = n * n_K / E_K
        slow_arm = (n - weight * slow_rate) / s, slow_rate
        fast_arm = (weight * fast_rate - n) / s, fast_rate
        return RelaxationSpectrum(None, None, (slow_arm, fast_arm))

    def material(self, theta: Sequence[float]) -> tuple[MaterialValue, ...]:
        """E and eta of the Maxwell element."""
        return (
            MaterialValue("elasticity", theta[0], (1.0, 0.0, 0.0, 0.0)),
            MaterialValue("viscosity", theta[1], (0.0, 1.0, 0.0, 0.0), "of the lasting flow"),
        )
