"""Records whose truth is known: an estimator's errors on them, in its own uncertainties and in those of the bound."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from palpate import ContactModel, Estimator, Floats, Problem, Samples, force_over_time
from palpate_kit.numerics.normal_equations import standard_errors

FORCE_STD, VELOCITY_STD = 0.05, 0.67e-3  # [N], [m/s], as in the paper
TIP_MASS = 0.14  # [kg], as in the paper
LOWEST, HIGHEST = 0.6, 1.6  # times the stated parameters, between which the truths lie (a choice)
DIFFERENCE_STEP = 1e-5  # of a parameter, for one-sided differences (a choice)


@dataclass(frozen=True)
class PressMotion:
    """A sine z = -(bias + amplitude sin(2 pi f t)) of the tip in the material, with the noise of the sensors."""

    bias: float = 3e-3  # [m]
    amplitude: float = 1e-3  # [m]
    frequency: float = 2.0  # [Hz]
    duration: float = 2.0  # [s]
    rate: float = 250.0  # [Hz]
    noise: float = 1.0  # times that of the sensors

    def samples(self, model: ContactModel, theta: Sequence[float], mass: float, seed: int) -> Samples:
        """Return samples of a material with parameters theta under a tip of a mass [kg], with noise by a seed."""
        rng = np.random.default_rng(seed)
        count = round(self.duration * self.rate)
        stamp = np.rint(np.arange(count) * (1e9 / self.rate)).astype(np.int64)
        time = stamp / 1e9
        omega = 2.0 * np.pi * self.frequency
        depth = self.bias + self.amplitude * np.sin(omega * time)
        speed = self.amplitude * omega * np.cos(omega * time)
        # The sensor feels u = F - m z'' with z'' = -d''.
        inertia = -mass * self.amplitude * omega**2 * np.sin(omega * time)
        force = force_over_time(model, time, depth, speed, theta) + inertia
        everywhere = np.ones(count, bool)
        return Samples(
            stamp=stamp,
            time=time,
            interval=np.concatenate([[0.0], np.diff(stamp) / 1e9]),
            force=force + self.noise * FORCE_STD * rng.standard_normal(count),
            position=-depth,
            velocity=-speed + self.noise * VELOCITY_STD * rng.standard_normal(count),
            contact=everywhere,
            active=everywhere.copy(),
        )


@dataclass(frozen=True)
class Errors:
    """Estimates of records of known truth: each row is a record, each column a parameter."""

    truth: Floats  # (n, k)
    values: Floats  # (n, k) at the end of each record; NaN where it says that it has none
    std: Floats  # (n, k) that it states
    bound: Floats  # (n, k) Cramer-Rao bound with a known surface and exact motion
    nis: Floats  # (n,) mean of the record's second half

    @property
    def relative(self) -> Floats:
        """Return the errors (n, k) over the truth."""
        return (self.values - self.truth) / self.truth

    @property
    def standardized(self) -> Floats:
        """Return the errors (n, k) over the stated standard deviations."""
        return (self.values - self.truth) / self.std


def estimate_records(
    estimator: Estimator, model: ContactModel, theta: Sequence[float], motion: PressMotion, records: int
) -> Errors:
    """Return the errors on so many records of a motion; their parameters are drawn around `theta`, log-uniformly."""
    rng = np.random.default_rng(0)
    factors = LOWEST * (HIGHEST / LOWEST) ** rng.random((records, len(theta)))
    lower = [parameter.lower for parameter in model.parameters]
    upper = [parameter.upper for parameter in model.parameters]
    truth = np.clip(factors * np.array(theta, float), lower, upper)
    values, stds, bounds, nis = [], [], [], []
    for seed, row in enumerate(truth.tolist()):
        samples = motion.samples(model, row, TIP_MASS, seed)
        estimates = estimator.start(Problem(model, TIP_MASS)).run(samples)
        values.append(estimates.values[-1])
        stds.append(estimates.std[-1])
        bounds.append(_lower_bound(model, row, samples))
        late = estimates.nis[len(samples) // 2 :]
        nis.append(float(np.mean(late[np.isfinite(late)])) if np.isfinite(late).any() else np.nan)
    return Errors(truth, np.array(values), np.array(stds), np.array(bounds), np.array(nis))


def _lower_bound(model: ContactModel, theta: Sequence[float], samples: Samples) -> Floats:
    """Return the Cramer-Rao bound (k,) of the parameters where surface and motion are known.

    No unbiased estimator has a smaller standard deviation: FORCE_STD times those of least squares with the Jacobian of
    the force, by differences.
    """
    depth = -samples.position
    rate = np.gradient(depth, samples.time)

    def force(values: Sequence[float]) -> Floats:
        """Return the force (n,) [N] at other parameters."""
        return force_over_time(model, samples.time, depth, rate, values)

    at_truth = force(theta)
    columns = []
    for index, number in enumerate(theta):
        step = DIFFERENCE_STEP * (abs(number) or 1.0)
        columns.append((force([*theta[:index], number + step, *theta[index + 1 :]]) - at_truth) / step)
    return FORCE_STD * standard_errors(np.column_stack(columns))
