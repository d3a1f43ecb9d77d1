"""How a table of a pipeline that was written for an older palpate reads today."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Migration:
    """What was renamed in the tables of one type of part, or in one plain table.

    ::

        Migration("0.2", "estimator", "afekf", keys={"theta": "fading.theta"})
        Migration("0.2", "estimator", "iekf", becomes="kinematic-ekf", implied={"iterations": 3})
    """

    since: str  # version with the names of today; files that state it, or a later one, are left alone
    table: str  # a kind of part, such as "estimator", or a plain table, such as "run"
    type: str = ""  # of the part; empty for a plain table
    keys: Mapping[str, str] = field(default_factory=dict)  # key of then -> key of today; dots lead into nested tables
    converted: Mapping[str, Callable[[Any], Any]] = field(default_factory=dict)  # by key of then: its value of today
    becomes: str = ""  # the type's name of today, where it has another
    implied: Mapping[str, Any] = field(default_factory=dict)  # keys that the type of then stood for
