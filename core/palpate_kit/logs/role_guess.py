"""The force, position and velocity among many columns: as something states it, else as they move together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from palpate import Floats

from palpate_kit.logs import role_evidence as evidence
from palpate_kit.logs.role_evidence import ContactEvidence, Derivative, Sign

ROLES = ("force", "position", "velocity")
# Choices.
_MIN_WITNESS_SHARE = 0.98  # of a velocity that the slope of a column explains, by which that is certainly the position
_MIN_RATE_SHARE = 0.8  # of a velocity that the slope of its position explains
_SAME_SHARE = 0.998  # of the variance of a column that a straight line of another explains, where both are the same
_FULL_BEND = 3.0  # standard errors of a bend, from which on it counts in full
_SETPOINT_RATIO = 3.0  # of the roughness of a measurement to that of its setpoint
_CLEAR_RATIO = 1.15  # of the score of the best to that of the next, from which on the best is taken without a doubt
_MIN_EXPLAINED_SHARE = 0.5  # of the variance of a force that its position explains, else the pick is a guess
_MIN_CORRELATION = 0.2  # magnitude, of force and position, from which on the sign of the position is certain
_ALTERNATIVE_RATIO = 0.5  # of the score of a column to that of the pick, from which on it is named as an alternative
_MAX_ALTERNATIVES = 4
_MAX_COLUMNS = 24  # that are compared pair by pair
_COMMAND_FACTOR = 0.5  # of the score of a column whose name is that of a setpoint
_ROUGH_POSITION_FACTOR = 0.9  # of the score of a position that is rougher than the force
_COMMAND_WORDS = ("desired", "target", "setpoint", "command", "cmd", "reference", "goal", "_des")
_MIN_READINGS = 20  # of a column
_ROUNDING = 1e-12  # of the magnitude of a column, beyond which it changes: four thousand roundings of a double


@dataclass(frozen=True, eq=False)
class NumberColumn:
    """One column of numbers over time."""

    label: str  # as a person names it, such as "/data:data[3]" or "column 4"
    time: Floats  # (n,) [s], or rows where no time is known
    values: Floats  # (n,) as recorded
    role: str | None = None  # that a type, a unit or a name states
    why: str = ""  # the reason for the role, such as "by its name"
    unit: str | None = None  # that a type, a name or a heading states
    key: tuple[str, str] = ("", "")  # topic and field
    named: bool = False  # True for a name that could state a role, unlike that of an element of an array

    @property
    def is_guess(self) -> bool:
        """True if nothing states its role, though it has a name."""
        return self.named and not self.why

    @property
    def commanded(self) -> bool:
        """True if its name marks it as commanded, not measured."""
        return any(text in self.label.lower() for text in _COMMAND_WORDS)


@dataclass(frozen=True)
class Pick:
    """The column that has a role, and the others that could have it."""

    series: NumberColumn
    why: str
    sure: bool
    others: tuple[NumberColumn, ...] = ()


@dataclass(frozen=True)
class RoleGuess:
    """The columns that have the roles, with the signs by which they count."""

    picks: Mapping[str, Pick]
    signs: Mapping[str, Sign]
    gain: float | None = None  # velocity over the slope of the position, as recorded, where there is a velocity
    law: ContactEvidence = field(default_factory=lambda: ContactEvidence(0.0, 0.0, 0.0))


class RoleSearch:
    """All columns on one grid, compared pair by pair; columns are named by their indices."""

    def __init__(self, series: Sequence[NumberColumn], chosen: Mapping[str, NumberColumn]) -> None:
        self._chosen = chosen
        moving = [column for column in series if does_move(column)]
        stated = [column for column in moving if column.role in ROLES or column in chosen.values()]
        self._series = list(dict.fromkeys([*chosen.values(), *stated, *moving]))[:_MAX_COLUMNS]
        self.step, self._columns = self._resample()
        self._roughness = [evidence.roughness(column.values[np.isfinite(column.values)]) for column in self._series]
        self._laws: dict[tuple[int, int], ContactEvidence] = {}

    def best_guess(self) -> RoleGuess | None:
        """Return the columns that are most likely force, position and velocity, with their signs.

        The pair of force and position is that of the best score. None if no column can be a force or a position.
        Columns are named by their indices.
        """
        pairs = self._scored_pairs()
        if not pairs:
            return None
        _, position, force = pairs[0]
        position = self._measured_position(position, force)
        velocity = self._velocity(position, force)
        law = self._law(position, force)
        # The best score of each column in a role: a dictionary keeps the last, hence the reverse order.
        force_scores = {column: score for score, _, column in reversed(pairs)}
        position_scores = {column: score for score, column, other in reversed(pairs) if other == force}
        picks = {
            "force": self._pick("force", force, force_scores, law),
            "position": self._pick("position", position, position_scores, law),
        }
        gain, share = self._gain_and_share(position, velocity)
        has_witness = self._has_rate(position)  # a column that is the derivative of the position
        if velocity is not None:
            rate_scores = {rate: fit.share for (place, rate), fit in self._rates.items() if place == position}
            picks["velocity"] = self._pick("velocity", velocity, rate_scores, None)
            has_witness = share > _MIN_WITNESS_SHARE
        # Without a name or a velocity as a witness all is a guess: force over position looks much as position over
        # force.
        if not has_witness and not any(self._series[column].why for column in (position, force)):
            picks = {role: replace(pick, sure=False) for role, pick in picks.items()}
        return RoleGuess(picks, self._signs(force, law, gain), gain, law)

    def _resample(self) -> tuple[float, list[Floats]]:
        """Return the step [s] of a common grid, and every column on it."""
        if not self._series:
            return 1.0, []
        times = [column.time for column in self._series]
        grid, columns = evidence.on_grid(times, [column.values for column in self._series])
        return float(grid[1] - grid[0]), columns

    def _candidates(self, role: str) -> list[int]:
        """Return the chosen column of a role, else those whose role is stated so, else those of no stated role."""
        if role in self._chosen:
            return [self._series.index(self._chosen[role])]
        chosen_columns = [self._series.index(column) for other, column in self._chosen.items() if other != role]
        free = [k for k in range(len(self._series)) if k not in chosen_columns]
        stated = [k for k in free if self._series[k].role == role]
        return stated or [k for k in free if self._series[k].role is None]

    @cached_property
    def _rates(self) -> dict[tuple[int, int], Derivative]:
        """The derivative of each pair of a position and its rate."""
        rates = {}
        for position in self._candidates("position"):
            for velocity in self._candidates("velocity"):
                if position == velocity:
                    continue
                rate = evidence.derivative(self._columns[position], self._columns[velocity], self.step)
                if rate.share > _MIN_RATE_SHARE:
                    rates[position, velocity] = rate
        return rates

    def _has_rate(self, position: int) -> bool:
        """Return True if a column is the rate of a position."""
        return any(place == position for place, _ in self._rates)

    def _law(self, position: int, force: int) -> ContactEvidence:
        """Return the law of a force over a position, computed once."""
        if (position, force) not in self._laws:
            self._laws[position, force] = evidence.contact_law(self._columns[position], self._columns[force])
        return self._laws[position, force]

    def _are_same(self, first: int, second: int) -> bool:
        """Return True if two columns are the same, but for an offset, a sign and a unit: by their correlation."""
        a, b = self._columns[first], self._columns[second]
        spread = float(a.std() * b.std())
        return spread > 0 and float(np.mean((a - a.mean()) * (b - b.mean())) / spread) ** 2 > _SAME_SHARE

    def _score(self, position: int, force: int) -> float:
        """Return a score of two columns as position and force; it is 0 or more, and has no upper limit.

        It is the share of the force that the law explains, times the root of the significance of its bend, times 1 plus
        the share of a velocity that the position explains, times factors for setpoints and for a rough position.
        """
        law = self._law(position, force)
        score = max(law.share, 0.0) * min(abs(law.bend) / _FULL_BEND, 1.0) ** 0.5
        score *= 1.0 + max((rate.share for (place, _), rate in self._rates.items() if place == position), default=0.0)
        for column, role in ((position, "position"), (force, "force")):
            if self._series[column].commanded and role not in self._chosen:
                score *= _COMMAND_FACTOR
        if self._roughness[position] > self._roughness[force]:
            score *= _ROUGH_POSITION_FACTOR
        return float(score)

    def _scored_pairs(self) -> list[tuple[float, int, int]]:
        """Return score, position and force of every pair of columns that may be that, the best first.

        A column of no stated role that is a rate, or the same as the position, is not a force.
        """
        rates = {velocity for _, velocity in self._rates}
        pairs = []
        for position in self._candidates("position"):
            for force in self._candidates("force"):
                if position == force:
                    continue
                is_open = "force" not in self._chosen and self._series[force].role is None
                if is_open and (force in rates or self._are_same(position, force)):
                    continue
                pairs.append((self._score(position, force), position, force))
        return sorted(pairs, key=lambda pair: -pair[0])

    def _gain_and_share(self, position: int, velocity: int | None) -> tuple[float | None, float]:
        """Return the factor between a velocity and the slope of a position, and the share of it that this explains."""
        if velocity is None:
            return None, 0.0
        rate = self._rates.get((position, velocity))
        if rate is not None:
            return rate.gain, rate.share
        return evidence.derivative(self._columns[position], self._columns[velocity], self.step).gain, 0.0

    def _measured_position(self, position: int, force: int) -> int:
        """Return the measurement if a position is a setpoint: a column much like it that is rougher, else itself.

        The score of a position says how well the force follows it by a law of contact; the larger, the better.
        """
        if "position" in self._chosen:
            return position
        min_score = self._score(position, force) / _CLEAR_RATIO
        min_roughness = _SETPOINT_RATIO * self._roughness[position]
        measurements = [
            column
            for column in self._candidates("position")
            if column not in (position, force)
            and self._score(column, force) > min_score
            and self._roughness[column] > min_roughness
            and not self._series[column].commanded
            and self._law(column, position).share > _MIN_RATE_SHARE
        ]
        return max(measurements, key=lambda column: self._score(column, force), default=position)

    def _velocity(self, position: int, force: int) -> int | None:
        """Return the chosen velocity, else the best rate of the position, else the only column stated as one."""
        if "velocity" in self._chosen:
            return self._series.index(self._chosen["velocity"])
        rates = [
            (rate.share, velocity)
            for (place, velocity), rate in self._rates.items()
            if place == position and velocity != force and not self._series[velocity].is_guess
        ]
        if rates:
            return max(rates)[1]
        stated = [column for column in self._candidates("velocity") if self._series[column].role == "velocity"]
        return stated[0] if len(stated) == 1 else None

    def _pick(self, role: str, column: int, scores: Mapping[int, float], law: ContactEvidence | None) -> Pick:
        """Return a column as the pick of a role, with the alternatives by their scores.

        `scores` are those of columns in that role, `law` the force over the position (None: it is not asked for). The
        pick is certain if it is the only candidate and something states its role, or if its score is clearly above that
        of all others and its law explains the force. A rival is a column of another topic, or of other values.
        """
        series = self._series[column]
        alternatives = self._alternatives(column, scores)
        rivals = [k for k in alternatives if self._series[k].key[0] != series.key[0] or not self._are_same(k, column)]
        is_clear = not rivals or scores.get(column, 0.0) > _CLEAR_RATIO * scores[rivals[0]]
        is_only_candidate = len(self._candidates(role)) == 1 and bool(series.why)
        is_explained = law is None or law.share > _MIN_EXPLAINED_SHARE
        return Pick(
            series,
            why=series.why or _reason(role, law),
            sure=not series.is_guess and (is_only_candidate or (is_clear and is_explained)),
            others=tuple(self._series[k] for k in alternatives),
        )

    def _alternatives(self, column: int, scores: Mapping[int, float]) -> list[int]:
        """Return other columns with at least half of the score of a pick, the best first; without its setpoints."""
        ranked = sorted((k for k in scores if k != column), key=lambda k: -scores[k])
        min_score = _ALTERNATIVE_RATIO * scores.get(column, 0.0)
        return [k for k in ranked if scores[k] > min_score and not self._is_setpoint(k, column)][:_MAX_ALTERNATIVES]

    def _is_setpoint(self, column: int, measurement: int) -> bool:
        """Return True if a column is commanded by its name, or much smoother than a measurement."""
        is_smooth = self._roughness[measurement] > _SETPOINT_RATIO * self._roughness[column]
        return self._series[column].commanded or is_smooth

    def _signs(self, force: int, law: ContactEvidence, gain: float | None) -> dict[str, Sign]:
        """Return the signs: of the force, of a position that falls as the force grows, and of the velocity."""
        force_sign = evidence.force_sign(self._columns[force], law)
        position_value = -1 if law.correlation * force_sign.value > 0 else 1
        position_reason = "the force grows as it falls" if position_value > 0 else "the force grows with it"
        is_clear = law.share > _MIN_EXPLAINED_SHARE and abs(law.correlation) > _MIN_CORRELATION
        is_sure = force_sign.sure and is_clear
        signs = {"force": force_sign, "position": Sign(position_value, position_reason, is_sure)}
        if gain is not None:
            agrees = gain >= 0
            value = position_value if agrees else -position_value
            reason = "it is the rate of the position" if agrees else "its sign is opposite to that of the position"
            signs["velocity"] = Sign(value, reason, is_sure and gain != 0.0)
        return signs


def _reason(role: str, law: ContactEvidence | None) -> str:
    """Return the reason for the pick of a role that nothing states: the share [%] that its law explains."""
    if role == "velocity":
        return "it is the derivative of the position"
    share = 0.0 if law is None else law.share
    if role == "force":
        return f"the position and its rate explain {100 * share:.0f} % of its movement"
    return f"it explains {100 * share:.0f} % of the force's movement"


def does_move(series: NumberColumn) -> bool:
    """Return True for a column of some readings that changes by more than its rounding."""
    numbers = series.values[np.isfinite(series.values)]
    if len(numbers) <= _MIN_READINGS:
        return False
    return float(np.ptp(numbers)) > _ROUNDING * float(np.abs(numbers).max()) > 0.0
