"""Lines of one or many recordings as one set of data: what they have in common, and how far recordings scatter."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from palpate import Floats
from palpate_kit.numerics.normal_equations import scaled_inverse

from palpate_spectra.complex_moduli import ModulusLine
from palpate_spectra.spectral_lines import Phasors

_ROUNDS = 20
_SETTLED = 1e-6  # of the largest modulus
_LEAST, _MOST = 1e-5, 3.0  # scatter of a modulus between recordings, as a share of it; below the least it is 0
_TRIED = (1e-4, 2e-3, 1e-2, 5e-2, 0.25)  # first, of each
_SINGULAR = 1e-9  # of the largest singular value


@dataclass(frozen=True)
class RecordingScatter:
    """Standard deviation of the moduli between recordings, as a share of them, beyond what they state themselves."""

    storage: float = 0.0
    loss: float = 0.0
    recordings: int = 1

    @property
    def parts(self) -> int:
        """How many of the two there are."""
        return int(self.storage > 0) + int(self.loss > 0)


@dataclass(frozen=True)
class Attempt:
    """A least-squares fit under one covariance."""

    residual: Floats  # (2 n,) data less model [Pa]
    slopes: Floats  # (2 n, p) of the model by its free parameters
    prediction: Phasors  # (n,) the model's G* [Pa]


@dataclass(frozen=True)
class JointFit:
    """A fit under the covariance that its own prediction gives."""

    attempt: Attempt
    half: Floats  # (2 n, 2 n) Cholesky factor of the covariance [Pa]
    scatter: RecordingScatter
    between: tuple[Floats, ...]  # (2 n, 2 n) parts of the covariance by the scatter of the recordings [Pa^2]

    @property
    def chi2(self) -> float:
        """Sum of the squares of the residuals, uncorrelated and in units of their standard deviation."""
        white = np.linalg.solve(self.half, self.attempt.residual)
        return float(white @ white)

    @property
    def log_determinant(self) -> float:
        """Logarithm of the covariance's determinant."""
        return 2.0 * float(np.log(self.half.diagonal()).sum())

    def uncertainty(self, slopes: Floats) -> Floats:
        """Standard uncertainties (p,) of parameters with these slopes (2 n, p) of the data.

        Where recordings scatter they are widened by t(nu)/t(inf) of 95 %, nu the degrees of freedom that the estimates
        of the scatter leave: Satterthwaite's, 2 V^2/var(V), by the information of the restricted likelihood.
        """
        from scipy.stats import t

        white = np.linalg.solve(self.half, slopes)
        sizes = np.maximum(np.linalg.norm(white, axis=0), 1e-300)
        white = white / sizes
        spread = scaled_inverse(white.T @ white)
        variance = np.maximum(spread.diagonal(), 1e-300)
        parts = [np.linalg.solve(self.half, np.linalg.solve(self.half, part).T) for part in self.between if part.any()]
        freedom = np.full(len(variance), np.inf)
        if parts:  # of each part's own size, so that its share is 1
            rest = np.eye(len(white)) - white @ spread @ white.T
            projected = [rest @ part @ rest for part in parts]
            information = np.array([[0.5 * np.sum(one * other) for other in projected] for one in projected])
            by_part = np.array([np.diag(spread @ white.T @ part @ white @ spread) for part in parts])
            spreading = np.sum(by_part * (scaled_inverse(information) @ by_part), axis=0)
            freedom = np.maximum(2.0 * variance**2 / np.maximum(spreading, 1e-300), 1.0)
        return np.asarray(np.sqrt(variance) / sizes * t.ppf(0.975, freedom) / t.ppf(0.975, np.inf))


def stack_moduli(lines: Sequence[ModulusLine], delay: float = 0.0) -> Floats:
    """G' of all lines, then G'' (2 n,) [Pa], of a force that is late by `delay` [s]."""
    return stack(np.array([line.delayed(delay) if delay else line.shear for line in lines], np.complex128))


def stack(values: Phasors) -> Floats:
    """Real parts, then imaginary parts (2 n,)."""
    return np.concatenate([values.real, values.imag])


def shared_covariance(lines: Sequence[ModulusLine], prediction: Phasors, without: Sequence[str] = ()) -> Floats:
    """Covariance (2 n, 2 n) [Pa^2] of `stack_moduli` by noise and by all that lines have in common.

    A common factor moves every line by the same share of what the material really is. Scaled by the measured values it
    would make small ones more certain than large ones, and a joint value below all of them (Peelle's puzzle; D'Agostini
    1994), so it is scaled by the prediction (n,) [Pa].
    """
    total = np.diag([line.noise**2 for line in lines] * 2)
    for name in dict.fromkeys(name for line in lines for name in line.shifts if name not in without):
        for apart in dict.fromkeys(line.apart.get(name, "") for line in lines):
            shift = np.array(
                [
                    _shift(line, name, predicted) if line.apart.get(name, "") == apart else 0.0
                    for line, predicted in zip(lines, prediction.tolist(), strict=True)
                ],
                np.complex128,
            )
            total = total + np.outer(stack(shift), stack(shift))
    return np.asarray(total)


def _shift(line: ModulusLine, name: str, predicted: complex) -> complex:
    """Shift of the predicted G* [Pa] by one standard uncertainty of a source; inertia knows nothing of the modulus."""
    shift = complex(line.shifts.get(name, 0.0))
    return shift if name == "mass" else shift * predicted / line.shear


def fit_jointly(
    lines: Sequence[ModulusLine], attempt: Callable[[Floats, int], Attempt], without: Sequence[str] = ()
) -> JointFit:
    """Return a fit to all lines; `attempt` is least squares under the covariance of a Cholesky factor (2 n, 2 n) [Pa],
    and gets how many there were before.

    Common factors are scaled by the fit's own prediction, and the scatter of the recordings is estimated from its
    residuals, until neither changes.
    """
    recordings = len({line.run for line in lines})
    measured = np.array([line.shear for line in lines], np.complex128)
    alone = np.sqrt(shared_covariance(lines, measured, without).diagonal())  # of each line by itself, as a start
    found, scatter = attempt(np.diag(alone), 0), RecordingScatter()
    half, between = np.diag(alone), tuple[Floats, ...]()
    for rounds in range(1, _ROUNDS):
        shared = shared_covariance(lines, found.prediction, without)
        if recordings > 1:
            parts = _parts(lines, found.prediction)
            scatter = _scatter(found, shared, parts, recordings)
            between = (scatter.storage**2 * parts[0], scatter.loss**2 * parts[1])
        half = np.asarray(np.linalg.cholesky(sum(between, shared)), np.float64)
        before, found = found.prediction, attempt(half, rounds)
        if np.abs(found.prediction - before).max() < _SETTLED * np.abs(before).max():
            break
    return JointFit(found, half, scatter, between)


def _parts(lines: Sequence[ModulusLine], prediction: Phasors) -> tuple[Floats, Floats]:
    """Covariances (2 n, 2 n) [Pa^2] of storage, and of loss moduli that differ by all of themselves by recording."""
    runs = list(dict.fromkeys(line.run for line in lines))
    of_run = np.array([[line.run == run for line in lines] for run in runs], float)
    nothing = np.zeros_like(of_run)
    storage = np.hstack([of_run * prediction.real, nothing])
    loss = np.hstack([nothing, of_run * prediction.imag])
    return storage.T @ storage, loss.T @ loss


def _scatter(found: Attempt, shared: Floats, parts: tuple[Floats, Floats], recordings: int) -> RecordingScatter:
    """Scatter of the recordings by restricted maximum likelihood (Patterson and Thompson 1971)."""
    from scipy.optimize import minimize

    scale = np.sqrt(shared.diagonal())
    across = scale[:, None] * scale
    unit, storage, loss = (part / across for part in (shared, *parts))
    residual, design = found.residual / scale, _column_space(found.slopes / scale[:, None])

    def cost(logarithms: Floats) -> float:
        first, second = np.exp(2.0 * logarithms)
        half = np.linalg.cholesky(unit + first * storage + second * loss)
        left, turned = np.linalg.solve(half, residual), np.linalg.solve(half, design)
        basis, triangle = np.linalg.qr(turned)
        rest = left - basis @ (basis.T @ left)
        determinants = np.log(half.diagonal()).sum() + np.log(np.abs(triangle.diagonal())).sum()
        return float(rest @ rest + 2.0 * determinants)

    bounds = [(math.log(_LEAST), math.log(_MOST))] * 2
    start = min(product(np.log(_TRIED), repeat=2), key=lambda pair: cost(np.array(pair)))
    best = minimize(cost, start, bounds=bounds, method="Nelder-Mead", options={"xatol": 1e-4, "fatol": 1e-7})
    shares = [share if share > 2 * _LEAST else 0.0 for share in np.exp(best.x).tolist()]
    return RecordingScatter(shares[0], shares[1], recordings)


def _column_space(slopes: Floats) -> Floats:
    """Return an orthonormal basis (2 n, r) of what the parameters can follow."""
    sizes = np.linalg.norm(slopes, axis=0)
    basis, values, _ = np.linalg.svd(slopes[:, sizes > 0] / sizes[sizes > 0], full_matrices=False)
    return np.asarray(basis[:, values > _SINGULAR * values.max(initial=0.0)])
