"""One step of the kinematic smoother, backwards, as a symbolic expression."""

from __future__ import annotations

from palpate_kit.kernel import Step

from palpate_filters.covariance import congruence, mirror, solve_symmetric
from palpate_filters.kinematic_step import NOISE_COUNT, KinematicNoise, predict, process_noise, report
from palpate_filters.process_models import KinematicProcess


def backward_step(process: KinematicProcess) -> Step:
    """Return one step of Rauch, Tung and Striebel's smoother, from the sample after to this one.

    With the filter's x and P, their prediction x-, P- = F P F^T + Q, and the smoothed x_after and P_after::

        G = P F^T (P-)^-1       x_s = x + G (x_after - x-)       P_s = (I - G F) P (I - G F)^T + G (Q + P_after) G^T

    The covariance is a sum of congruences, so it stays positive. State: smoothed mean (n) and covariance (n x n).
    Sample: filtered mean, covariance, interval [s] to the sample after, and measured height [m]. Settings: the noises.
    Output: `report` and the mean.
    """
    import casadi as ca

    # Symbols; of a covariance only the upper triangle is read.
    n = process.states
    mean_after, square_after = ca.SX.sym("xs", n), ca.SX.sym("Ps", n, n)
    mean, square = ca.SX.sym("x", n), ca.SX.sym("P", n, n)
    interval, height, numbers = ca.SX.sym("T"), ca.SX.sym("z"), ca.SX.sym("p", NOISE_COUNT)
    noise, covariance = KinematicNoise(*ca.vertsplit(numbers)), mirror(square)

    # The filter's prediction again, and the smoother's gain G.
    prediction, predicted_covariance, jacobian = predict(process, mean, covariance, interval, noise)
    gain = solve_symmetric(predicted_covariance, jacobian @ covariance).T
    # Smoothed mean and covariance.
    x = mean + gain @ (mean_after - prediction)
    reduction = ca.SX.eye(n) - gain @ jacobian
    covariance_after = mirror(process_noise(process, interval, noise) + mirror(square_after))
    P = mirror(congruence(reduction, covariance) + congruence(gain, covariance_after))
    return Step(
        state=ca.vertcat(mean_after, ca.vec(square_after)),
        sample=ca.vertcat(mean, ca.vec(square), interval, height),
        settings=numbers,
        next_state=ca.vertcat(x, ca.vec(P)),
        output=ca.vertcat(report(process, x, P, height), x),
    )
