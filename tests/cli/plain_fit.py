"""A least-squares fit without frills, as a file beside a pipeline: E and eta linear, the surface searched for."""

import numpy as np
from palpate import Estimates, Estimator, contact_force, plugin


class PlainFit(Estimator):
    """F + m d'' = u on all active samples, by least squares in E, eta and the height of the surface."""

    online = False

    def start(self, problem):
        """A tracker that wants all samples at once."""
        return _Fit(problem)


class _Fit:
    def __init__(self, problem):
        self.problem = problem

    def run(self, samples):
        found, rows = Estimates.idle(samples, 2), np.flatnonzero(samples.active)
        part = samples[rows]
        step = 10
        curvature = np.zeros(len(samples))
        z, t = samples.position, samples.time
        curvature[step:-step] = (z[2 * step :] - 2 * z[step:-step] + z[: -2 * step]) / (t[step] - t[0]) ** 2
        force = part.force + self.problem.tip_mass * curvature[rows]
        known = np.isfinite(force)

        def fit(surface):
            depth, model = surface - part.position, self.problem.model
            columns = [contact_force(model, depth, -part.velocity, unit) for unit in ((1.0, 0.0), (0.0, 1.0))]
            design = np.column_stack(columns)[known]
            theta = np.linalg.lstsq(design / [1e-5, 1e-3], force[known], rcond=None)[0] / [1e-5, 1e-3]
            return theta, float(((force[known] - design @ theta) ** 2).sum()), design

        from scipy.optimize import minimize_scalar

        best = minimize_scalar(lambda s: fit(s)[1], bounds=(-1e-3, 2e-3), method="bounded", options={"xatol": 1e-9})
        theta, cost, design = fit(best.x)
        std = np.sqrt(cost / known.sum() * np.diag(np.linalg.inv(design.T @ design)))
        found.values[rows], found.std[rows], found.status[rows] = theta, std, 0
        found.surface[rows], found.surface_std[rows] = best.x, 1e-6
        found.force[rows] = contact_force(self.problem.model, best.x - part.position, -part.velocity, theta)
        return found


@plugin
def palpate_estimators():
    return {"plain-fit": PlainFit}
