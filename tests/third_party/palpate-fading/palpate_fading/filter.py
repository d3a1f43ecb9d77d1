"""Least squares that forget what is old."""

import math

import numpy as np
from palpate import (
    Belief,
    ConfigurationError,
    Estimator,
    Force,
    Length,
    Moment,
    Problem,
    Status,
    Time,
    Tracker,
    contact_force,
    track_by_step,
)
from pydantic import Field

MAX_CONDITION = 1e10  # of the scaled information: beyond it the record does not determine the parameters


class FadingSquares(Estimator):
    """Least squares of u = F(d, d') with a known surface, in which a reading counts the less the older it is."""

    surface: Length = Field(default=0.0, description="height of the untouched surface")
    force_std: Force = Field(default=0.05, gt=0, description="standard deviation of the force")
    fading: Time = Field(default=10.0, gt=0, description="time after which a reading counts by a factor of 1/e")

    def start(self, problem: Problem) -> Tracker:
        """Begin without any information."""
        model = problem.model
        if model.memory or any(parameter.role is None for parameter in model.parameters):
            raise ConfigurationError("the force must be proportional to every parameter, without memory")
        count = len(model.parameters)
        information, moment_sum = np.zeros((count, count)), np.zeros(count)

        def step(moment: Moment) -> Belief:
            depth, rate = self.surface - moment.position, -moment.velocity
            remembered = math.exp(-moment.interval / self.fading)
            information[:], moment_sum[:] = remembered * information, remembered * moment_sum
            if np.isfinite(moment.force) and np.isfinite(rate):
                row = np.array([contact_force(model, depth, rate, unit) for unit in np.eye(count).tolist()])
                information[:] += np.outer(row, row) / self.force_std**2
                moment_sum[:] += row * moment.force / self.force_std**2
            scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
            scaled = information / np.outer(scale, scale)
            if np.linalg.cond(scaled) > MAX_CONDITION:
                nothing = np.full(count, np.nan)
                return Belief(nothing, nothing, depth, 0.0, np.nan, status=Status.WAITING)
            covariance = np.linalg.inv(scaled) / np.outer(scale, scale)
            values = covariance @ moment_sum
            force = float(contact_force(model, depth, rate, values.tolist()))
            return Belief(values, np.sqrt(np.diag(covariance)), depth, 0.0, force)

        return track_by_step(count, step)
