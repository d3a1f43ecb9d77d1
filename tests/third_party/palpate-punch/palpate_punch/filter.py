"""Recursive least squares in plain numpy."""

import numpy as np
from palpate import Belief, Estimator, Force, Length, track_by_step
from pydantic import Field


class RecursiveLeastSquares(Estimator):
    """Recursive least squares for a surface whose height is known; the tip's inertia is neglected.

    Measured force = sum of parameter times the force of the model with that parameter 1 and the others 0.
    """

    surface: Length = Field(description="height of the untouched surface")
    force_std: Force = Field(default=0.05, gt=0, description="standard deviation of the force")

    def start(self, problem):
        """A tracker for any model that is linear in its parameters."""
        model = problem.model
        k = len(model.parameters)
        ones = np.eye(k)
        state = {"information": np.zeros((k, k)), "moment": np.zeros(k)}

        def step(moment):
            depth, rate = self.surface - moment.position, -moment.velocity
            if depth > 0 and np.isfinite(moment.force) and np.isfinite(rate):
                row = np.array([model.force(depth, rate, one) for one in ones]) / self.force_std
                state["information"] = state["information"] + np.outer(row, row)
                state["moment"] = state["moment"] + row * moment.force / self.force_std
            covariance = np.linalg.pinv(state["information"], hermitian=True)
            values = covariance @ state["moment"]
            force = float(model.force(max(depth, 0.0), rate, values))
            return Belief(values, np.sqrt(np.abs(np.diag(covariance))), depth, 0.0, force)

        return track_by_step(k, step)
