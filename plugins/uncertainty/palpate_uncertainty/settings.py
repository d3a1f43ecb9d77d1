"""Tables of a pipeline file that judges of results read."""

from __future__ import annotations

from palpate import Settings
from pydantic import Field


class ChoiceSettings(Settings):
    """The ``[choice]`` table: models between which only the record can choose.

    Each estimator's tracks of these models are weighed by exp(-dBIC n_eff/n / 2), n_eff of n residuals being
    independent, so that correlated residuals do not feign certainty. Every candidate's budget includes its distance
    from the combined value.
    """

    candidates: tuple[str, ...] = Field(
        min_length=2, description="names of the [model.*] tables that the stated geometry admits"
    )
