"""A tool that turns: what its weight did over a record, and whether the readings in free air follow it."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray
from palpate.alignment_report import TurnedTool
from palpate.vectors import Floats

from palpate_engine.alignment.tool_frame import Load, Vector

# Whole tenths of a millinewton, micrometres and tenths of a degree: sums of them do not depend on how a record is cut
# into blocks.
_PER_NEWTON, _PER_METRE, _PER_CURVATURE = 1e4, 1e6, 1e4
_MAX_PARTS = 1e7  # of such parts, 1 kN or 10 m; what is beyond is not a reading: a choice
_MIN_SAMPLES = 100  # before a spread or a slope is stated: a choice
# Columns of a row: reading (3), weight (3), weight along the normal, place (3), height, curvature and its std, tilt.
_FORCES, _WEIGHT, _ALONG = 6, slice(3, 6), 6
_PLACES, _CURVATURE, _TILT = slice(7, 11), slice(11, 13), 13
_WIDTHS = 7, 4, 2, 1  # columns in newtons, metres, 1/metres and radians
_COLUMNS = sum(_WIDTHS)
_PER_RADIAN, _MAX_TILT = 1800 / math.pi, 1800  # tenths of a degree; half a turn
_AXES = 4  # x, y, z and height of a stay
_TILT_QUANTILE = 0.99  # of the samples in contact; a few next to an edge turn more: a choice


class ToolWatch:
    """Sums over all samples; what is in contact is known later than the readings."""

    def __init__(self) -> None:
        self._waiting = np.zeros((0, _COLUMNS), np.int64)
        self._air, self._contact, self._stays = _Sums(), _Sums(), _Stays()
        self._tilts = np.zeros(_MAX_TILT + 1, np.int64)  # how many samples in contact have each

    def add(
        self, load: Load, place: Vector, height: Floats, tilt: Floats, curvature: Floats, curvature_std: Floats
    ) -> None:
        """Take in samples to be released: forces [N], place of the tip [m], its height above the skin.

        And the angle between tool and normal [rad], the skin's curvature [1/m] and its std.
        """
        forces = np.column_stack([*load.reading, *load.weight, load.weight_along]) * _PER_NEWTON
        places = np.column_stack([*place, height]) * _PER_METRE
        curved = np.column_stack([curvature, curvature_std]) * _PER_CURVATURE
        columns = np.column_stack([forces, places, curved, tilt * _PER_RADIAN])
        columns = np.where(np.isfinite(columns), columns, 2.0 * _MAX_PARTS).clip(-2.0 * _MAX_PARTS, 2.0 * _MAX_PARTS)
        self._waiting = np.concatenate([self._waiting, np.rint(columns).astype(np.int64)])

    def release(self, contact: NDArray[np.bool_]) -> None:
        """Take in the first of the samples that wait, with whether they are in contact (n,)."""
        rows, self._waiting = self._waiting[: len(contact)], self._waiting[len(contact) :]
        usable = (np.abs(rows) < _MAX_PARTS).all(axis=1)
        if not self._contact.count:  # later air may be wet, or not yet free
            is_before_contact = np.cumsum(contact) == 0
            self._air.add(rows[is_before_contact & usable])
        self._contact.add(rows[contact & usable])
        self._tilts += np.bincount(rows[contact & usable, _TILT], minlength=_MAX_TILT + 1)
        self._stays.add(rows[:, _PLACES], contact & usable)

    @property
    def turned(self) -> TurnedTool | None:
        """Return what the tool and its weight did over the samples released so far; None without any."""
        air, contact = self._air, self._contact
        if not air.count and not contact.count:
            return None
        # Means in contact and in air, each in place of the other where it has no samples.
        contact_mean, air_mean = (contact if contact.count else air).mean, (air if air.count else contact).mean
        spread, disagreement, std = air.disagreement() if air.count >= _MIN_SAMPLES else (0.0, None, 0.0)
        turn, weight = float(np.linalg.norm(contact_mean[_WEIGHT] - air_mean[_WEIGHT])), float(contact_mean[_ALONG])
        # Drift over the stays of the tip, curvature below it, and the tilt that a share of the samples does not exceed.
        slope = self._stays.slope if contact.count >= _MIN_SAMPLES else 0.0
        curvature, deviation = contact.mean[_CURVATURE].tolist() if contact.count else (0.0, 0.0)
        tilt = int(np.searchsorted(np.cumsum(self._tilts), _TILT_QUANTILE * self._tilts.sum())) / _PER_RADIAN
        along = weight - float(air_mean[_ALONG])
        return TurnedTool(
            turn=turn,
            along=along,
            weight=weight,
            spread=spread,
            apart=disagreement,
            apart_std=std,
            slope=slope,
            curvature=curvature,
            curvature_std=deviation,
            tilt=tilt,
        )


class _Sums:
    """Sums and products of whole numbers (n, 14)."""

    def __init__(self) -> None:
        self.count = 0
        self._sum = [0] * _COLUMNS
        self._products: dict[tuple[int, int], int] = {}

    def add(self, rows: NDArray[np.int64]) -> None:
        """Take in rows."""
        self.count += len(rows)
        for i in range(_COLUMNS):
            self._sum[i] += int(rows[:, i].sum())
        for i, j in itertools.combinations_with_replacement(range(_FORCES), 2):
            self._products[i, j] = self._products.get((i, j), 0) + int((rows[:, i] * rows[:, j]).sum())

    def _moment(self, i: int, j: int) -> float:
        """Return the covariance of two columns, in whole parts."""
        n, pair = self.count, (min(i, j), max(i, j))
        return (n * self._products[pair] - self._sum[i] * self._sum[j]) / (n * n)

    @property
    def mean(self) -> Floats:
        """Means (14,) of forces [N], places [m], curvature and its standard uncertainty [1/m], and the tilt [rad]."""
        parts = np.repeat([_PER_NEWTON, _PER_METRE, _PER_CURVATURE, _PER_RADIAN], _WIDTHS)
        return np.asarray(np.array(self._sum, float) / self.count / parts, np.float64)

    def disagreement(self) -> tuple[float, float | None, float]:
        """Return the spread of the weight w [N], |cov(f - w, w)| / |cov(w, w)| of readings f, and its uncertainty.

        The ratio is None where the weight does not change. Readings and weight have three axes each.
        """
        axes = range(_FORCES)
        moments = np.array([[self._moment(i, j) for j in axes] for i in axes]) / _PER_NEWTON**2
        # Covariances (3, 3) of the readings f, of f with w, and of the weight w.
        reading_covariance, cross_covariance, weight_covariance = moments[:3, :3], moments[:3, 3:], moments[3:, 3:]
        spread, size = math.sqrt(max(float(np.trace(weight_covariance)), 0.0)), float(np.linalg.norm(weight_covariance))
        if size <= 0.0:
            return spread, None, 0.0
        # Variance of f - w of one axis: what noise leaves where the weight explains the readings.
        noise_variance = max(
            float(np.trace(reading_covariance) - 2.0 * np.trace(cross_covariance) + np.trace(weight_covariance)) / 3.0,
            0.0,
        )
        # By linear regression, the noise of a ratio of covariances is its sigma/sqrt(n) over the spread of w.
        noise = math.sqrt(3.0 * noise_variance / self.count) * spread / size
        return spread, float(np.linalg.norm(cross_covariance - weight_covariance)) / size, noise


class _Stays:
    """Scatter of the tip while in contact, about the mean place of each stay: x, y, z and height (n, 4)."""

    def __init__(self) -> None:
        self._count, self._sums, self._squares = 0, [0] * _AXES, [0] * _AXES  # of the present one
        self._scatter = [0.0] * _AXES  # of all that are over

    def add(self, rows: NDArray[np.int64], contact: NDArray[np.bool_]) -> None:
        """Take in rows; a stay ends where one is not in contact."""
        edges = [0, *(np.flatnonzero(np.diff(contact)) + 1).tolist(), len(contact)]
        for begin, end in itertools.pairwise(edges if len(contact) else []):
            if not contact[begin]:
                self._scatter, self._count = self._whole, 0
                self._sums, self._squares = [0] * _AXES, [0] * _AXES
                continue
            self._count += end - begin
            for i in range(_AXES):
                column = rows[begin:end, i]
                self._sums[i] += int(column.sum())
                self._squares[i] += int((column * column).sum())

    @property
    def _whole(self) -> list[float]:
        """Sums (4,) of the squared deviations of all stays, the present one included, in whole parts."""
        if not self._count:
            return self._scatter
        present = zip(self._scatter, self._sums, self._squares, strict=True)
        return [past + (self._count * square - total * total) / self._count for past, total, square in present]

    @property
    def slope(self) -> float:
        """Tangent of the angle between the normal and the motion; 0 without motion along it."""
        *place, height = self._whole
        return math.sqrt(max(sum(place) / height - 1.0, 0.0)) if height > 0 else 0.0
