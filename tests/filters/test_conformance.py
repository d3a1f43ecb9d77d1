"""Every estimator on every kind of contact model keeps the promises of `palpate_testing`."""

from __future__ import annotations

import pytest
from palpate import ConfigurationError, ContactModel, Estimator
from palpate.offers import import_target
from palpate_filters import palpate_estimators
from palpate_testing import check_estimator

MODELS = ("sphere", "quartic", "kelvin-voigt", "hunt-crossley", "relaxing")
OTHERS = (pytest.param(model, marks=pytest.mark.slow) for model in MODELS[1:])
LINEAR = {"ting-fit": ("sphere", "quartic")}  # estimators for materials with a relaxation modulus alone


@pytest.mark.gate
@pytest.mark.parametrize("model", [MODELS[0], *OTHERS])
@pytest.mark.parametrize("estimator", palpate_estimators())
def test_estimator_conforms(
    estimator: str, model: str, contact_models: dict[str, tuple[ContactModel, list[float]]]
) -> None:
    part: type[Estimator] = import_target(palpate_estimators()[estimator])
    if model in LINEAR.get(estimator, MODELS):
        check_estimator(part(), *contact_models[model])
    else:
        with pytest.raises(ConfigurationError, match=f"{estimator}: .* relaxation modulus"):
            check_estimator(part(), *contact_models[model])
