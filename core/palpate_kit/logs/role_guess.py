"""Which of many numbers are force, position and velocity: what states it, else what they do together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from palpate import Floats

from palpate_kit.logs import role_evidence as evidence
from palpate_kit.logs.role_evidence import ContactEvidence, Derivative, Sign

ROLES = ("force", "position", "velocity")
_CERTAIN = 0.98  # share by which a velocity is a witness of which column is the position
_RATE = 0.8  # share of a velocity that a slope must explain
_SAME = 0.998  # share of one column that a straight line of another explains, where both say the same
_BENT = 3.0  # standard errors of a bend that count in full
_SMOOTHER = 3.0  # ratio of roughness that distinguishes a setpoint from a measurement
_CLEARLY = 1.15  # how much better the best must be than the next to be taken without a doubt
_EXPLAINED = 0.5  # share of the force's movement that the position must explain, at least
_OTHERS = 4  # alternatives that are named
_MOST = 24  # columns that are compared pair by pair
_COMMAND = ("desired", "target", "setpoint", "command", "cmd", "reference", "goal", "_des")


@dataclass(frozen=True, eq=False)
class NumberColumn:
    """One column of numbers over time."""

    label: str  # as a person names it, such as "/data:data[3]" or "column 4"
    time: Floats  # (n,) [s], or rows where no time is known
    values: Floats  # (n,) as recorded
    role: str | None = None  # that a type, a unit or a name states
    why: str = ""  # by what
    unit: str | None = None  # that something states
    key: tuple[str, str] = ("", "")  # topic and field
    named: bool = False  # by a text that could state a role, unlike an element of an array

    @property
    def is_guess(self) -> bool:
        """True if nothing states its role, though it has a name."""
        return self.named and not self.why

    @property
    def commanded(self) -> bool:
        """True if its name marks it as commanded, not measured."""
        return any(word in self.label.lower() for word in _COMMAND)


@dataclass(frozen=True)
class Pick:
    """What serves as a role, and what else could."""

    series: NumberColumn
    why: str
    sure: bool
    others: tuple[NumberColumn, ...] = ()


@dataclass(frozen=True)
class RoleGuess:
    """The roles, and which way they count."""

    picks: Mapping[str, Pick]
    signs: Mapping[str, Sign]
    gain: float | None = None  # velocity over the slope of the position, as recorded, where there is a velocity
    law: ContactEvidence = field(default_factory=lambda: ContactEvidence(0.0, 0.0, 0.0))


class Search:
    """All columns on one grid, compared pair by pair."""

    def __init__(self, series: Sequence[NumberColumn], chosen: Mapping[str, NumberColumn]) -> None:
        self._chosen = chosen
        moving = [s for s in series if does_move(s)]
        stated = [s for s in moving if s.role in ROLES or s in chosen.values()]
        self._series = list(dict.fromkeys([*chosen.values(), *stated, *moving]))[:_MOST]
        self.step, self._columns = self._on_grid()
        self._rough = [evidence.roughness(s.values[np.isfinite(s.values)]) for s in self._series]
        self._laws: dict[tuple[int, int], ContactEvidence] = {}

    def _on_grid(self) -> tuple[float, list[Floats]]:
        if not self._series:
            return 1.0, []
        grid, columns = evidence.on_grid([s.time for s in self._series], [s.values for s in self._series])
        return float(grid[1] - grid[0]), columns

    def _may(self, role: str) -> list[int]:
        """Who can play a role: who is chosen, else who is stated to, else everybody of whom nothing is stated."""
        if role in self._chosen:
            return [self._series.index(self._chosen[role])]
        taken = [self._series.index(s) for r, s in self._chosen.items() if r != role]
        stated = [k for k, s in enumerate(self._series) if s.role == role and k not in taken]
        return stated or [k for k, s in enumerate(self._series) if s.role is None and k not in taken]

    @cached_property
    def _rates(self) -> dict[tuple[int, int], Derivative]:
        """Pairs of a position and its rate."""
        pairs = ((p, v) for p in self._may("position") for v in self._may("velocity") if p != v)
        found = {pair: evidence.derivative(self._columns[pair[0]], self._columns[pair[1]], self.step) for pair in pairs}
        return {pair: d for pair, d in found.items() if d.share > _RATE}

    def _law(self, p: int, f: int) -> ContactEvidence:
        if (p, f) not in self._laws:
            self._laws[p, f] = evidence.contact_law(self._columns[p], self._columns[f])
        return self._laws[p, f]

    def _same(self, one: int, other: int) -> bool:
        """Return True if two columns are the same, but for an offset, a sign and a unit."""
        a, b = self._columns[one], self._columns[other]
        spread = float(a.std() * b.std())
        return spread > 0 and float(np.mean((a - a.mean()) * (b - b.mean())) / spread) ** 2 > _SAME

    def _score(self, p: int, f: int) -> float:
        """How well two columns go together as position and force."""
        law = self._law(p, f)
        score = max(law.share, 0.0) * min(abs(law.bend) / _BENT, 1.0) ** 0.5
        score *= 1.0 + max((d.share for (place, _), d in self._rates.items() if place == p), default=0.0)
        for k, free in ((p, "position"), (f, "force")):
            commanded = self._series[k].commanded and free not in self._chosen
            score *= 0.5 if commanded else 1.0
        return float(score * (0.9 if self._rough[p] > self._rough[f] else 1.0))

    def found(self) -> RoleGuess | None:
        """Return the best roles; None where nothing can be a force or a position."""
        pairs = self._pairs()
        if not pairs:
            return None
        _, p, f = pairs[0]
        p = self._measured(p, f)
        law, speed = self._law(p, f), self._velocity(p, f)
        picks = {
            "force": self._pick("force", f, {k: s for s, _, k in reversed(pairs)}, law),
            "position": self._pick("position", p, {k: s for s, k, other in reversed(pairs) if other == f}, law),
        }
        told = any(self._series[k].why for k in (p, f))
        gain, share = self._moves(p, speed)
        if speed is not None:
            rivals = {k: d.share for (place, k), d in self._rates.items() if place == p}
            picks["velocity"] = self._pick("velocity", speed, rivals, None)
            told = told or share > _CERTAIN  # else its witness is a guess
        else:
            told = told or any(place == p for place, _ in self._rates)
        if not told:  # force over position looks much as position over force
            picks = {role: replace(pick, sure=False) for role, pick in picks.items()}
        return RoleGuess(picks, self._signs(p, f, law, gain), gain, law)

    def _pairs(self) -> list[tuple[float, int, int]]:
        """Score, position and force of every pair of columns that may be that, the best first."""
        rates = {v for _, v in self._rates}
        free = "force" not in self._chosen
        pairs = [
            (self._score(p, f), p, f)
            for p in self._may("position")
            for f in self._may("force")
            if p != f and not (free and self._series[f].role is None and (f in rates or self._same(p, f)))
        ]
        return sorted(pairs, key=lambda pair: -pair[0])

    def _moves(self, p: int, speed: int | None) -> tuple[float | None, float]:
        """By what factor a velocity is the slope of a position, and the share of it that this explains."""
        if speed is None:
            return None, 0.0
        rate = self._rates.get((p, speed))
        return (rate.gain, rate.share) if rate is not None else (self._gain(p, speed), 0.0)

    def _measured(self, p: int, f: int) -> int:
        """Of positions that serve as well, the rougher one: a setpoint is smoother than any measurement."""
        if "position" in self._chosen:
            return p
        best = self._score(p, f)
        rivals = [k for k in self._may("position") if k not in (p, f) and self._score(k, f) > best / _CLEARLY]
        rougher = [k for k in rivals if self._rough[k] > _SMOOTHER * self._rough[p] and not self._series[k].commanded]
        alike = [k for k in rougher if self._law(k, p).share > _RATE]
        return max(alike, key=lambda k: self._score(k, f)) if alike else p

    def _velocity(self, p: int, f: int) -> int | None:
        if "velocity" in self._chosen:
            return self._series.index(self._chosen["velocity"])
        mine = [
            (d.share, v)
            for (place, v), d in self._rates.items()
            if place == p and v != f and not self._series[v].is_guess
        ]
        if mine:
            return max(mine)[1]
        stated = [k for k in self._may("velocity") if self._series[k].role == "velocity"]
        return stated[0] if len(stated) == 1 else None

    def _gain(self, p: int, v: int) -> float:
        return evidence.derivative(self._columns[p], self._columns[v], self.step).gain

    def _pick(self, role: str, k: int, scores: Mapping[int, float], law: ContactEvidence | None) -> Pick:
        series = self._series[k]
        ranked = sorted((o for o in scores if o != k), key=lambda o: -scores[o])
        others = [o for o in ranked if scores[o] > 0.5 * scores.get(k, 0.0) and not self._setpoint(o, k)][:_OTHERS]
        rivals = [o for o in others if self._series[o].key[0] != series.key[0] or not self._same(o, k)]
        clear = not rivals or scores.get(k, 0.0) > _CLEARLY * scores[rivals[0]]
        sole = len(self._may(role)) == 1 and bool(series.why)
        explained = law is None or law.share > _EXPLAINED
        why = series.why or self._reason(role, law)
        sure = not series.is_guess and (sole or (clear and explained))
        return Pick(series, why, sure, tuple(self._series[o] for o in others))

    def _setpoint(self, other: int, mine: int) -> bool:
        return self._series[other].commanded or self._rough[mine] > _SMOOTHER * self._rough[other]

    @staticmethod
    def _reason(role: str, law: ContactEvidence | None) -> str:
        if role == "velocity":
            return "it is the derivative of the position"
        share = 0.0 if law is None else law.share
        if role == "force":
            return f"the position and its rate explain {100 * share:.0f} % of its movement"
        return f"it explains {100 * share:.0f} % of the force's movement"

    def _signs(self, p: int, f: int, law: ContactEvidence, gain: float | None) -> dict[str, Sign]:
        force = evidence.force_sign(self._columns[f], law)
        falls = -1 if law.correlation * force.value > 0 else 1
        clear = law.share > _EXPLAINED and abs(law.correlation) > 0.2
        words = "the force grows as it falls" if falls > 0 else "the force grows with it"
        signs = {"force": force, "position": Sign(falls, words, force.sure and clear)}
        if gain is not None:
            agrees = gain >= 0
            words = "it is the rate of the position" if agrees else "its sign is opposite to that of the position"
            signs["velocity"] = Sign(falls if agrees else -falls, words, force.sure and clear and gain != 0.0)
        return signs


def does_move(series: NumberColumn) -> bool:
    """Return True for a column that changes by more than its rounding."""
    good = series.values[np.isfinite(series.values)]
    return len(good) > 20 and float(np.ptp(good)) > 1e-12 * float(np.abs(good).max()) > 0.0
