"""Materials that relax by a power of time: springpot and fractional Kelvin-Voigt, as sums of exponentials."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, ClassVar, Self

from palpate import MaterialValue, Parameter, Time
from pydantic import Field, model_validator

from palpate_models.parameters import ELASTICITY, LASTING_ELASTICITY
from palpate_models.relaxation_spectrum import RelaxationSpectrum
from palpate_models.relaxing_models import RelaxingModel

_STATES = 10  # a choice: exponentials; the trapezoidal rule over ln(rate) is then within 1 % over `_MAX_DECADES`
_MARGIN = 10.0  # a choice: the exponentials' times reach so many times beyond those for which the law is to hold
_MAX_DECADES = 3.2  # from `shortest` to `longest`; measured: up to there the error stays within 1 %
# Coefficients of Lanczos' approximation for g = 7 and nine terms (P. Godfrey 2001).
_LANCZOS = (
    0.99999999999980993, 676.5203681218851, -1259.1392167224028, 771.32342877765313, -176.61502916214059,
    12.507343278686905, -0.13857109526572012, 9.9843695780195716e-6, 1.5056327351493116e-7,
)  # fmt: skip
_ELASTICITY = Parameter(
    ELASTICITY.name, "E", ELASTICITY.unit, "Young's modulus a second after a step", role="elastic",
    start=ELASTICITY.start, start_std=ELASTICITY.start_std,
)  # fmt: skip
_FADING = Parameter(
    "fading_elasticity", "E_f", "Pa", "part of Young's modulus that fades by a power, a second after a step",
    start=20e3, start_std=50e3,
)  # fmt: skip
_POWER = Parameter(
    "power", "alpha", "1", "power of time by which the modulus fades; tan(delta) = tan(alpha pi/2)",
    lower=1e-3, upper=0.9, start=0.1, start_std=0.1,
)  # fmt: skip


def reciprocal_gamma(x: Any) -> Any:
    """Return 1/Gamma(x) for 0 < x < 1 in plain operators, by Lanczos' approximation of Gamma(1 + x) to 1e-14."""
    t = x + 7.5  # g + 1/2 with g = 7
    series = _LANCZOS[0] + sum(c / (x + i) for i, c in enumerate(_LANCZOS[1:], start=1))
    return x * math.e**t / (math.sqrt(2.0 * math.pi) * t ** (x + 0.5) * series)


class _Fractional(RelaxingModel):
    """A power law of time between two times, as a spring, a damper and ten arms."""

    memory: ClassVar[tuple[str, ...]] = tuple(f"force_{k}" for k in range(1, _STATES + 1))

    shortest: Time = Field(default=0.02, gt=0, description="shortest time after a change at which the law is valid")
    longest: Time = Field(default=20.0, gt=0, description="longest time at which the law is valid")

    @model_validator(mode="after")
    def _check_span(self) -> Self:
        """Raise ValueError where the shortest and longest times are too far apart for the exponentials."""
        decades = math.log10(self.longest / self.shortest)
        if not 0 < decades <= _MAX_DECADES:
            raise ValueError(
                f"shortest {self.shortest:g} s and longest {self.longest:g} s are {decades:.2g} decades apart; "
                f"{_STATES} exponentials are the power law within 1 % over up to {_MAX_DECADES:g}"
            )
        return self

    def _arms(self, strength: Any, power: Any) -> RelaxationSpectrum:
        """Return E_1 (t/1 s)^-alpha as E_1/Gamma(alpha) h sum of x_k^alpha exp(-x_k t), x_k = exp(k h).

        The trapezoidal rule on the integral over ln x. All slower terms have not relaxed by `longest` and are a spring,
        all faster ones have by `shortest` and are a damper: geometric series, both.
        """
        # Rates x_k at equal steps of the logarithm.
        first = math.log(1.0 / (_MARGIN * self.longest))
        step = (math.log(_MARGIN / self.shortest) - first) / (_STATES - 1)
        scale = strength * reciprocal_gamma(power) * step
        rates = [math.exp(first + k * step) for k in range(_STATES)]
        # The terms beyond both ends.
        ratio = math.exp(step)
        spring = scale * rates[0] ** power / (ratio**power - 1.0)
        damper = scale * rates[-1] ** (power - 1.0) / (ratio ** (1.0 - power) - 1.0)
        arms = tuple((scale * rate**power, rate) for rate in rates)
        return RelaxationSpectrum(spring, damper / (2.0 * (1.0 + self.poisson)), arms)


class PowerLaw(_Fractional):
    """A material whose modulus fades by a power of time (a springpot), pressed by any axisymmetric tip.

    F = 2/(1 - nu^2) int E(t - s) dA(d(s)) with E(t) = E (t/1 s)^-alpha, as a spring, a damper and ten Maxwell arms from
    `shortest`/10 to 10 `longest`, F = 2 E_s/(1 - nu^2) A(d) + 4 eta_s/(1 - nu) a(d) d' + sum of q_k: E(t) within 1 %
    from `shortest` to `longest`. On a ramp d = v t a paraboloid has F = 2 sqrt(R)/(1 - nu^2) E v^1.5 B(1.5, 1 - alpha)
    (1 s)^alpha t^(1.5 - alpha); in a sine tan(delta) = tan(alpha pi/2) at every frequency.
    Assumes what `standard-linear-solid` does. A constant loss angle is what a delay of the force makes at one
    frequency: alpha needs two, or a ramp and a hold, or a known delay.
    Source: Lee and Radok 1960; Bagley and Torvik 1983 for the springpot; the trapezoidal rule over ln(rate).
    """

    parameters: ClassVar[tuple[Parameter, ...]] = (_ELASTICITY, _POWER)

    def spectrum(self, theta: Sequence[Any]) -> RelaxationSpectrum:
        """E (t/1 s)^-alpha."""
        return self._arms(theta[0], theta[1])

    def material(self, theta: Sequence[float]) -> tuple[MaterialValue, ...]:
        """E after a second."""
        return (MaterialValue("elasticity", theta[0], (1.0, 0.0), "a second after a step"),)


class FractionalKelvinVoigt(_Fractional):
    """A spring in parallel with a springpot, pressed by any axisymmetric tip.

    F = 2/(1 - nu^2) int E(t - s) dA(d(s)) with E(t) = E + E_f (t/1 s)^-alpha, as a spring, a damper and ten Maxwell
    arms, F = 2 E_s/(1 - nu^2) A(d) + 4 eta_s/(1 - nu) a(d) d' + sum of q_k, within 1 % of E_f from `shortest` to
    `longest` (see `power-law`). alpha near 1 is a damper: `dimensionality-reduction`. Assumes what `power-law` does.
    Where alpha is small, E and E_f cannot be distinguished by a short record: the fits flag it. Source: Lee and Radok
    1960; Bagley and Torvik 1983; Mainardi 2010, fractional Kelvin-Voigt model.
    """

    parameters: ClassVar[tuple[Parameter, ...]] = (LASTING_ELASTICITY, _FADING, _POWER)

    def spectrum(self, theta: Sequence[Any]) -> RelaxationSpectrum:
        """E + E_f (t/1 s)^-alpha."""
        fading = self._arms(theta[1], theta[2])
        return RelaxationSpectrum(theta[0] + fading.lasting, fading.damper, fading.arms)

    def material(self, theta: Sequence[float]) -> tuple[MaterialValue, ...]:
        """E at rest."""
        return (MaterialValue("elasticity", theta[0], (1.0, 0.0, 0.0), "at rest"),)
