"""Every estimator on every kind of contact model keeps the promises of `palpate_testing`."""

from __future__ import annotations

import pytest
from palpate import ContactModel, Estimator
from palpate_filters import palpate_estimators
from palpate_testing import check_estimator

MODELS = ("sphere", "quartic", "kelvin-voigt", "hunt-crossley", "relaxing")


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("estimator", palpate_estimators())
def test_estimator_conforms(
    estimator: str, model: str, contact_models: dict[str, tuple[ContactModel, list[float]]]
) -> None:
    part: type[Estimator] = palpate_estimators()[estimator]
    check_estimator(part(), *contact_models[model])
