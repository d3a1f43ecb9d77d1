"""The standstill before a motion: whether its readings are plausible, and as noisy as the filters declare."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from palpate.errors import DeviceError

from palpate_engine.safety import SafetySettings

Noise = Mapping[str, tuple[float, float]]  # what estimators count on, by name: force [N], velocity [m/s]


@dataclass(frozen=True)
class Standstill:
    """Force and velocity while the tip hangs still in free air."""

    force: float  # [N] mean
    force_std: float  # [N]
    velocity_std: float | None  # [m/s]; None where none is measured

    def table(self) -> dict[str, float | None]:
        """As in ``result.json``."""
        return {"force": self.force, "force_std": self.force_std, "velocity_std": self.velocity_std}


def refuse_unsteady(standstill: Standstill, limits: SafetySettings, force: str, declared: Noise) -> None:
    """Raise DeviceError with advice where a standstill moves, or is not what was expected.

    `force` is the name of the channel, `declared` the noise of force and velocity that each estimator counts on.
    """
    if abs(standstill.force) > limits.standstill_force:
        raise DeviceError(
            f"{force} reads {standstill.force:.2f} N at standstill, over [safety] standstill_force = "
            f"{limits.standstill_force:g} N: is the tip free, and is nothing pulling at the cable?"
        )
    if standstill.force_std > limits.standstill_noise:
        raise DeviceError(
            f"{force} has a noise of {standstill.force_std:.3f} N at standstill, more than [safety] standstill_noise = "
            f"{limits.standstill_noise:g} N: is the rig at rest? a longer filter of the sensor lowers it"
        )
    if standstill.velocity_std is not None and standstill.velocity_std > limits.standstill_speed:
        raise DeviceError(
            f"the velocity has a noise of {1e3 * standstill.velocity_std:.2f} mm/s at standstill, more than "
            f"[safety] standstill_speed = {1e3 * limits.standstill_speed:g} mm/s: is the arm at rest?"
        )
    for name, (force_std, velocity_std) in declared.items():
        _refuse_surprise(
            subject=f"{force} has a noise",
            std=standstill.force_std,
            unit="N",
            estimator=name,
            declaration=f"force_std = {force_std:g} N",
            expected=force_std,
            limits=limits,
        )
        if standstill.velocity_std is not None:
            declaration = f"velocity_std = {1e3 * velocity_std:g} mm/s"
            _refuse_surprise(
                subject="the velocity has a noise",
                std=standstill.velocity_std,
                unit="mm/s",
                estimator=name,
                declaration=declaration,
                expected=velocity_std,
                limits=limits,
            )


def _refuse_surprise(
    subject: str, std: float, unit: str, estimator: str, declaration: str, expected: float, limits: SafetySettings
) -> None:
    """Raise DeviceError where a standard deviation [SI] at standstill is larger than an estimator expects, times an
    excess."""
    if std <= limits.standstill_excess * expected:
        return
    shown = 1e3 * std if unit == "mm/s" else std
    raise DeviceError(
        f"{subject} of {shown:.3g} {unit} at standstill, {std / expected:.1f} times what the filter declares "
        f"([estimator.{estimator}] {declaration}; [safety] standstill_excess = {limits.standstill_excess:g}): set "
        'noise = "measure", so that the filter takes what is measured at standstill, or look for what disturbs the rig'
    )
