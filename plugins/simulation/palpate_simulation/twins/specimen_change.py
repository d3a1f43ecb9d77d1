"""Changes of start and specimen for a twin that runs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from palpate_simulation.twins.settings import BenchSettings


def restart_at(settings: BenchSettings, numbers: list[float]) -> BenchSettings:
    """Return settings with the tip elsewhere at the start: position [mm] and rotation vector of the tool [deg].

    Raises ValueError unless these are six numbers.
    """
    if len(numbers) != 6:
        raise ValueError
    x, y, z = (np.array(numbers[:3]) / 1e3).tolist()
    rotation = np.radians(numbers[3:]).tolist()
    return settings.model_copy(update={"place": (x, y), "height": z, "tool_rotation": tuple(rotation)})


def soften_specimen(settings: BenchSettings, elasticity: float) -> BenchSettings:
    """Return settings with another elasticity [Pa] of the specimen, and its other parameters in proportion."""
    specimen = settings.specimen
    factor = elasticity / specimen.parameters["elasticity"]
    parameters = {name: factor * value for name, value in specimen.parameters.items()}
    return settings.model_copy(update={"specimen": specimen.model_copy(update={"parameters": parameters})})
