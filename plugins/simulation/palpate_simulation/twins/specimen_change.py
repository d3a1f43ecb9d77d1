"""Other starts and other specimens for a twin that runs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from palpate_simulation.twins.settings import BenchSettings


def restart_at(settings: BenchSettings, numbers: list[float]) -> BenchSettings:
    """Return the tip elsewhere at the start: place [mm] and rotation vector of the tool [deg]; raises ValueError."""
    if len(numbers) != 6:
        raise ValueError
    place, turn = (np.array(numbers[:3]) / 1e3).tolist(), np.radians(numbers[3:]).tolist()
    changes = {"place": tuple(place[:2]), "height": place[2], "tool_rotation": tuple(turn)}
    return settings.model_copy(update=changes)


def soften_specimen(settings: BenchSettings, elasticity: float) -> BenchSettings:
    """Return a specimen of another elasticity [Pa], and all else in proportion."""
    specimen = settings.specimen
    factor = elasticity / specimen.parameters["elasticity"]
    parameters = {name: factor * value for name, value in specimen.parameters.items()}
    return settings.model_copy(update={"specimen": specimen.model_copy(update={"parameters": parameters})})
