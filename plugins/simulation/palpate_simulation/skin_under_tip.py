"""The skin of a simulated specimen under a tip, and the force along the normal there."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from palpate import ConfigurationError, Floats, contact_force, force_over_time, loading_cycle_force

from palpate_simulation.skin_form import elliptic_share
from palpate_simulation.skin_on_surface import SkinOnSurface
from palpate_simulation.specimen import Specimen

MAX_SWING = 2e-5  # [m] that a position loop may swing back within a loading (a choice)
MIN_FACTOR = 0.01  # of the stiffness over soft inclusions (a choice): the sum of their contrasts may be below -1


class SkinUnderTip:
    """Depth, normal and parameters of a specimen under a tip at positions (n, 3) [m], each computed at most once."""

    def __init__(self, specimen: Specimen, position: Floats) -> None:
        self._specimen, self._position = specimen, position
        self._x, self._y = position[:, 0], position[:, 1]

    def deeper(self, distance: float) -> SkinUnderTip:
        """Return the skin under a tip that is deeper along the normal by a distance [m]."""
        return SkinUnderTip(self._specimen, self._position - distance * self.normal)

    @cached_property
    def _centre(self) -> Floats:
        """Centres (n, 3) [m] of the sphere that a tip ends in, over the origin of the skin."""
        specimen = self._specimen
        return np.asarray(self._position + np.array([0.0, 0.0, specimen.tip_radius - specimen.surface]))

    @cached_property
    def _near(self) -> tuple[Floats, Floats]:
        """Distances (n,) [m] of the centres from a skin that has a form, and the normals (n, 3) to them."""
        assert self._specimen.form is not None
        return self._specimen.form.near(self._centre)

    @cached_property
    def normal(self) -> Floats:
        """Outward normals (n, 3)."""
        return np.broadcast_to((0.0, 0.0, 1.0), self._position.shape) if self._specimen.form is None else self._near[1]

    @cached_property
    def depth(self) -> Floats:
        """Depth (n,) [m] of the tip below the true skin along the normal, of a round tip that of its deepest point."""
        specimen = self._specimen
        if specimen.form is None:
            return specimen.surface + specimen.relief.height_at(self._x, self._y) - self._position[:, 2]
        depth = specimen.tip_radius - self._near[0]
        if specimen.relief.roughness > 0:
            depth = depth + self.normal[:, 2] * specimen.relief.without_form.height_at(self._x, self._y)
        return np.asarray(depth)

    @cached_property
    def _slopes(self) -> tuple[Floats, Floats]:
        """Slopes (n,) of the roughness towards x and y."""
        return self._specimen.relief.without_form.slopes_at(self._x, self._y)

    def rate(self, velocity: Floats) -> Floats:
        """Return how fast the depth grows (n,) [m/s] with velocities (n, 3) [m/s] of the tip."""
        rate = -np.sum(velocity * self.normal, axis=1)
        if self._specimen.relief.roughness > 0 and velocity.any():
            slope_x, slope_y = self._slopes
            rate = rate + self.normal[:, 2] * (slope_x * velocity[:, 0] + slope_y * velocity[:, 1])
        return np.asarray(rate)

    @cached_property
    def share(self) -> Floats | float:
        """Force on the curved skin over that on a flat one at the same depth; (n,) on a body, a number elsewhere."""
        form, radius = self._specimen.form, self._specimen.tip_radius
        if isinstance(form, SkinOnSurface):
            return form.share(self._centre, radius)
        return elliptic_share(radius, form.curvatures) if form is not None and any(form.curvatures) else 1.0

    @cached_property
    def theta(self) -> list[Any]:
        """Parameters of the model that the tip feels, each a number or (n,).

        Inclusions multiply those that the force is proportional to by 1 + the sum of their contrasts. On a body, the
        distance of an inclusion is that of the skin over it, straight through.
        """
        specimen = self._specimen
        theta: list[Any] = [specimen.parameters[parameter.name] for parameter in specimen.model.parameters]
        if not specimen.inclusions:
            return theta
        radius = 0.0 if specimen.indenter is None else float(specimen.indenter.contact_radius(specimen.felt_at))
        if isinstance(specimen.form, SkinOnSurface):
            feet = specimen.form.feet(self._centre)
            contrasts = [
                inclusion.contrast_at(np.linalg.norm(feet - over, axis=1), radius)
                for inclusion, over in zip(specimen.inclusions, specimen.over_inclusions, strict=True)
            ]
        else:
            contrasts = [inclusion.contrast(self._x, self._y, radius) for inclusion in specimen.inclusions]
        return self._stiffened(theta, np.maximum(1.0 + sum(contrasts), MIN_FACTOR))

    def _stiffened(self, theta: list[Any], factor: Floats) -> list[Any]:
        """Return the parameters; those that the force is proportional to are multiplied by a factor (n,)."""
        roles = [parameter.role for parameter in self._specimen.model.parameters]
        return [value * factor if role else value for value, role in zip(theta, roles, strict=True)]

    def push(self, instants: Floats, velocity: Floats) -> Floats:
        """Return the force (n,) [N] along the normal on the tip with velocities (n, 3) [m/s].

        The instants (n,) [s] are in order. Raises ConfigurationError for a model with memory on a specimen with
        inclusions, or that forgets too fast for the instants.
        """
        specimen, force = self._specimen, self._force(instants, velocity)
        if specimen.form is not None:
            force = force * self.share
        if specimen.scatter is not None:
            force = force * specimen.scatter.at(self._x, self._y)
        return force if specimen.conditioning is None else force * specimen.conditioning.factor(specimen.palpated)

    def _force(self, instants: Floats, velocity: Floats) -> Floats:
        """Return the force (n,) [N] of the model on a flat, uniform skin."""
        if self._specimen.unloading == "ting":
            return self._ting_force(instants)
        if self._specimen.model.memory:
            return self._remembered_force(instants, velocity)
        return self._instantaneous_force(velocity)

    def _instantaneous_force(self, velocity: Floats) -> Floats:
        """Return the force (n,) [N] of a model without memory."""
        specimen, depth = self._specimen, self.depth
        # Most of the time a live twin is in the air: nothing is to be computed there.
        if not specimen.model.adhesive and depth.max(initial=0.0) <= 0.0:
            return np.zeros(len(depth))
        theta = self.theta
        if specimen.layers:
            theta = self._stiffened(theta, np.interp(depth, *specimen.layered))
        return np.asarray(contact_force(specimen.model, depth, self.rate(velocity), theta, pulls=False), float)

    def _remembered_force(self, instants: Floats, velocity: Floats) -> Floats:
        """Return the force (n,) [N] of a model with memory, which depends on the motion before."""
        specimen = self._specimen
        if specimen.inclusions:
            raise ConfigurationError("device sim: specimen: a model with memory can have no inclusions")
        try:
            return force_over_time(specimen.model, instants, self.depth, self.rate(velocity), self.theta, pulls=False)
        except ValueError as error:
            raise ConfigurationError(f"device sim: specimen: {error}") from error

    def _ting_force(self, instants: Floats) -> Floats:
        """Return the contact force (n,) [N] after Ting (1966); raises ConfigurationError for a layered specimen."""
        specimen = self._specimen
        if specimen.inclusions or specimen.layers:
            raise ConfigurationError('device sim: specimen: unloading = "ting" is for a homogeneous material')
        try:
            return loading_cycle_force(specimen.model, instants, self.depth, self.theta, MAX_SWING)
        except ValueError as error:
            raise ConfigurationError(f"device sim: specimen: {error}") from error
