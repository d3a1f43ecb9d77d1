"""Score tests of a residual along directions: its noise, what a fit takes of it, and one step to an alternative."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import count

import numpy as np
from numpy.typing import NDArray
from palpate import Floats

from palpate_uncertainty.chi_square import chance_of_more
from palpate_uncertainty.discrepancy import Explanation
from palpate_uncertainty.residual_null import ResidualNull

# A wrong record of six deviations is far beyond the level: it sets the share of right ones that are doubted.
LEVEL = 1e-3  # of a record: chance that a right one fails the tests (choice)
SAYS_NOTHING = 10.0 * LEVEL  # a chance from which on a test says nothing (choice)
VISIBLE_SIGMAS = 4.0  # standard deviations by which an alternative of its typical size must show (choice)
MIN_VARIANCE = 1e-6  # of the largest variance, below which a direction does not count (choice)
MIN_SINGULAR_VALUE = 1e-4  # of the largest, below which a direction of an alternative is rounding (choice)
_SMALLEST = 1e-300  # in a quotient or a root, in place of 0: near the smallest double


@dataclass(frozen=True)
class Directions:
    """Directions of an alternative: its derivatives over the standard deviation of the residual, each of length 1."""

    scaled: Floats  # (n, m)
    lengths: Floats  # (m,)
    sharp: Floats  # (n, m) in which they stand out most
    overlap: Floats  # (m, m) of these with what the fit leaves of the derivatives
    covariance: Floats  # (m, m) of the sums by noise
    sums: Floats  # (m,) of the residual

    def one(self, k: int) -> Directions:
        """Return one of several alternatives of one derivative each."""
        column = slice(k, k + 1)
        return Directions(
            scaled=self.scaled[:, column],
            lengths=self.lengths[column],
            sharp=self.sharp[:, column],
            overlap=self.overlap[column, column],
            covariance=self.covariance[column, column],
            sums=self.sums[column],
        )


@dataclass(frozen=True)
class TestedResidual:
    """A residual that is tested along directions."""

    space: ResidualSpace
    null: ResidualNull
    residual: Floats  # (n,) [N]
    count: int  # of parameters

    def along(self, columns: Floats) -> Directions:
        """Return the residual along the derivatives (n, m) of an alternative, or of several of one each."""
        scaled = columns / self.space.std[:, None]
        lengths = np.maximum(np.linalg.norm(scaled, axis=0), _SMALLEST)
        scaled = scaled / lengths
        unfitted = self.space.beside(scaled)
        sharp = self.space.sharpest(unfitted)
        weights = sharp / self.space.std[:, None]
        covariance, sums = self.null.covariance(weights), weights.T @ self.residual
        return Directions(
            scaled=scaled, lengths=lengths, sharp=sharp, overlap=sharp.T @ unfitted, covariance=covariance, sums=sums
        )

    def along_each(self, patterns: list[tuple[str, Floats, float]]) -> Iterator[Directions]:
        """Yield the same of every alternative; those of one derivative are computed together."""
        single = [columns for _, columns, _ in patterns if columns.shape[1] == 1]
        together, places = self.along(np.column_stack(single)), count()
        for _, columns, _ in patterns:
            yield together.one(next(places)) if columns.shape[1] == 1 else self.along(columns)

    def shows(self, alternative: Directions, typical: float) -> bool:
        """Return True if an alternative of a typical size would stand out by four standard deviations."""
        if math.isinf(typical):
            return True
        sizes = typical * alternative.lengths
        spread = math.sqrt(max(float(sizes @ alternative.covariance @ sizes), _SMALLEST))
        return float(sizes @ alternative.overlap @ sizes) >= VISIBLE_SIGMAS * spread

    def score(self, alternative: Directions, one_sided: bool = False) -> Explanation:
        """Return the test along an alternative: chi square of its independent sums."""
        powers, axes = self._axes(alternative)
        freedom, value = axes.shape[1], axes.T @ alternative.sums
        gain = 0.0 if one_sided and alternative.sums[0] < 0 else float(np.sum(value**2 / powers))
        p = tail_probability(freedom, gain, self.null.force.readings) if freedom else 1.0
        return Explanation(gain, freedom, p, len(self.residual))

    def step(self, columns: Floats, typical: float, one_sided: bool, inside: int) -> Explanation:
        """Return the test along the derivatives (n, m) of an alternative, with one step to it.

        The first `inside` rows are in contact.
        """
        alternative = self.along(columns)
        test, axes = self.score(alternative, one_sided), self._axes(alternative)[1]
        sizes = np.linalg.lstsq(axes.T @ alternative.overlap, axes.T @ alternative.sums, rcond=MIN_VARIANCE)[0]
        moved = -self.space.taken_by(alternative.scaled @ sizes)[: self.count]
        times = float(np.max(np.abs(sizes) / alternative.lengths)) / typical
        return replace(test, shifts=moved, times=times, power=self._power(alternative, test, inside))

    def _power(self, alternative: Directions, test: Explanation, inside: int) -> float:
        """Return the mean square [N^2] in contact of the residual along an alternative, less that by chance."""
        directions, sizes, _ = np.linalg.svd(self.space.beside(alternative.scaled), full_matrices=False)
        directions = directions[:, sizes > MIN_SINGULAR_VALUE * sizes[0]]
        along = directions @ (directions.T @ (self.residual / self.space.std)) * self.space.std
        beyond_chance = max(1.0 - test.numbers / test.gain, 0.0) if test.gain > 0 else 0.0
        return beyond_chance * float(np.mean(along[:inside] ** 2))

    def excess(self, inside: int, explanations: Iterable[Explanation]) -> float:
        """Return the mean square [N^2] in contact that neither noise nor declared inputs explain.

        At least that along the best alternative: a pattern far below the noise of single readings is seen there alone.
        """
        undeclared = self.space.sharpest(self.residual / self.space.std) * self.space.std
        noise = float(np.mean(self.null.std[:inside] ** 2))
        visible = float(np.mean(undeclared[:inside] ** 2)) - noise
        return max(visible, 0.0, *(explanation.power for explanation in explanations))

    @staticmethod
    def _axes(alternative: Directions) -> tuple[Floats, Floats]:
        """Return the variances (d,) of an alternative's independent sums, and their directions (m, d)."""
        powers, axes = np.linalg.eigh(alternative.covariance)
        independent = powers > MIN_VARIANCE * max(float(powers[-1]), _SMALLEST)
        return powers[independent], axes[:, independent]


@dataclass(frozen=True)
class ResidualSpace:
    """Residuals over their standard deviation, and what the fit and open facts take of them."""

    std: Floats  # (n,) [N]
    basis: Floats  # (n, b) orthonormal
    fitted: Floats  # (n, f) what the fit takes
    free: NDArray[np.bool_]  # (k + 1,) parameters and surface that it determines
    stated: Floats  # (n, s) what each stated quantity takes in addition

    @classmethod
    def of(
        cls,
        std: Floats,
        jacobian: Floats,
        free: NDArray[np.bool_],
        open_facts: list[Floats],
        stated: list[Floats],
    ) -> ResidualSpace:
        """Return the space of residuals of a standard deviation (n,) [N] without what is free, open and stated."""
        fitted = jacobian[:, free]
        columns = np.column_stack([fitted, *open_facts]) / std[:, None]
        basis = np.linalg.qr(columns / np.maximum(np.linalg.norm(columns, axis=0), _SMALLEST))[0]
        alone = cls(std=std, basis=basis, fitted=fitted / std[:, None], free=free, stated=np.zeros((len(std), 0)))
        return replace(alone, stated=np.column_stack([np.zeros(len(std)), *(alone.beside(s / std) for s in stated)]))

    def beside(self, values: Floats) -> Floats:
        """Return values (n, ...) less the part of them that fit and open facts take."""
        return np.asarray(values - self.basis @ (self.basis.T @ values))

    def taken_by(self, values: Floats) -> Floats:
        """Return the shifts (k + 1,) of parameters and surface by which a fit follows values (n,); 0 if fixed."""
        sizes = np.maximum(np.linalg.norm(self.fitted, axis=0), _SMALLEST)
        moved = np.zeros(len(self.free))
        moved[self.free] = np.linalg.lstsq(self.fitted / sizes, values, rcond=None)[0] / sizes
        return moved

    def sharpest(self, values: Floats) -> Floats:
        """Return the direction (n, ...) in which values stand out most from the noise and what is stated."""
        both = np.eye(self.stated.shape[1]) + self.stated.T @ self.stated
        return np.asarray(values - self.stated @ np.linalg.solve(both, self.stated.T @ values))


def effective_count(directions: list[Floats]) -> float:
    """Return how many independent tests those along correlated directions (n,) amount to (Nyholt 2004)."""
    if len(directions) < 2:
        return float(len(directions))
    rows = np.array([direction / np.linalg.norm(direction) for direction in directions])
    powers = np.linalg.eigvalsh(rows @ rows.T)
    return 1.0 + (len(directions) - 1.0) * (1.0 - float(np.var(powers, ddof=1)) / len(directions))


def tail_probability(freedom: int, value: float, readings: int) -> float:
    """Return the chance of more than a chi square whose variance n readings determine: F with n - 1 degrees of freedom.

    F has the longer tail: where that of chi square says nothing, it is the answer, without the import of scipy.
    """
    if (chance := chance_of_more(freedom, value)) > SAYS_NOTHING:
        return chance
    from scipy.special import fdtrc

    return float(fdtrc(freedom, max(readings - 1, 1), value / freedom))
