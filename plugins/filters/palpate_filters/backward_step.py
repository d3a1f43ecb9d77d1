"""One step of the kinematic smoother, backwards, as a symbolic expression."""

from __future__ import annotations

from palpate_kit.kernel import Step

from palpate_filters.covariance import congruence, mirror, solve_symmetric
from palpate_filters.kinematic_step import NOISES, KinematicNoise, predicted, process_noise, report
from palpate_filters.process_models import KinematicProcess


def backward_step(process: KinematicProcess) -> Step:
    """One step of Rauch, Tung and Striebel's smoother, from the sample after to this one.

    State: smoothed mean (n) and covariance (n x n). Sample: filtered mean, covariance, interval [s] to the sample
    after, and measured height [m]. Settings: the noises. Output: what is reported, without NIS and marks, and the
    mean. The covariance is a sum of congruences, so it stays positive: (I - G F) P (I - G F)^T + G (Q + P_after) G^T.
    """
    import casadi as ca

    n = process.states
    after, after_covariance = ca.SX.sym("xs", n), ca.SX.sym("Ps", n, n)
    mean, square = ca.SX.sym("x", n), ca.SX.sym("P", n, n)
    covariance, later_covariance = mirror(square), mirror(after_covariance)
    interval, height, numbers = ca.SX.sym("T"), ca.SX.sym("z"), ca.SX.sym("p", NOISES)
    noise = KinematicNoise(*ca.vertsplit(numbers))
    ahead, ahead_covariance, jacobian = predicted(process, mean, covariance, interval, noise)
    gain = solve_symmetric(ahead_covariance, jacobian @ covariance).T
    x = mean + gain @ (after - ahead)
    kept = ca.SX.eye(n) - gain @ jacobian
    added = mirror(process_noise(process, interval, noise) + later_covariance)
    P = mirror(congruence(kept, covariance) + congruence(gain, added))
    return Step(
        state=ca.vertcat(after, ca.vec(after_covariance)),
        sample=ca.vertcat(mean, ca.vec(square), interval, height),
        settings=numbers,
        next_state=ca.vertcat(x, ca.vec(P)),
        output=ca.vertcat(report(process, x, P, height), x),
    )
