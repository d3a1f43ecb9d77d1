"""The states of a live run: standstill, ready, moving."""

from __future__ import annotations

from palpate.clocks import clock
from palpate.device import ReportsHealth
from palpate.errors import ConfigurationError, DeviceError, error_text
from palpate.sound_force import NO_SET_FORCE
from palpate.trajectory import ForceControlled, Trajectory, surface_of

from palpate_engine.alignment import GRAVITY
from palpate_engine.pipeline.approach import check_start
from palpate_engine.pipeline.live.arm_preparation import refuse_preload, send_limits
from palpate_engine.pipeline.live.live_run import LiveRun
from palpate_engine.pipeline.live.retreat_check import RetreatCheck, check_tip_is_free
from palpate_engine.pipeline.live.rise_check import ExpectedForce
from palpate_engine.pipeline.live.standstill import Noise, Standstill
from palpate_engine.pipeline.live.stored_offset import Offset, stored_offset
from palpate_engine.safety import SafetySettings

_MAX_TIP_MASS = 0.2  # [kg] behind a sensor, where it is not stated: at most so much, as a rule; a choice
_BRAKES = 1.2  # [s] from a stop to a standstill, which takes 1 s at most (0455), and until it is reported
_PATIENCE = 8.0  # [s] for a retraction, or for a device that is slow to begin: a choice
_LOOK = 0.02  # [s] between looks at what has come: a choice


def stand_still(live: LiveRun, noise: Noise) -> Standstill | None:
    """Return force and velocity at standstill; None where the run was stopped. Raises DeviceError like the guard.

    The standstill is over when the samples, and not only the host's clock, say so: it is the same stretch of the record
    in a replay, which has no host's clock.
    """
    guard, began = live.guard, clock().now()
    # A device may be slow to begin; one that has failed trips the guard.
    while (
        not (guard.has_stood_still and live.has_sampled_standstill)
        and clock().now() - began < live.standstill + _PATIENCE
    ):
        for arrivals in live.links.until(max(began + live.standstill, clock().now() + _LOOK)):
            live.pass_on(arrivals)
        if live.is_stopped:
            return None
    return None if live.is_stopped else guard.judge_standstill(noise)


def compensable_offset(live: LiveRun) -> Offset | None:
    """Return the stored reading of the sensor in free air; None where none is stored, or no arm is to move."""
    if live.trajectory is None or live.rig.safety is None or not live.arms:
        return None
    health = {name: link.health for name, link in live.links.links.items() if isinstance(link, ReportsHealth)}
    return stored_offset(live.rig, health)


def get_ready(live: LiveRun, standstill: Standstill, offset: Offset | None) -> RetreatCheck | None:
    """Send the arms their limits, check the way to the start, and start the guard; return what a retreat measured.

    Raises DeviceError where the tip is not free or a stream gives no samples, ConfigurationError without a motion.
    """
    guard, trajectory, limits = live.guard, live.trajectory, live.rig.safety
    if not live.has_sampled_standstill:
        raise DeviceError(
            f"within {live.standstill + _PATIENCE:g} s the streams gave no samples of {live.standstill:g} s in common"
        )
    if live.arms and trajectory is None:
        raise ConfigurationError(f"{live.rig.path}: a robot needs one [trajectory.*] table")
    if trajectory is None or limits is None or not live.arms:
        guard.begin(live.arms)
        return None
    # A load on the sensor at standstill would be hidden by the tare.
    known_offset = offset.value if offset is not None and offset.doubt is None else None
    refuse_preload(standstill.force, limits, guard.force, known_offset)
    # The guard compares the force with what acceleration, a law, the stiffest material and drift explain.
    alignment = live.rig.alignment
    inertia = _inertia(alignment.tip_mass, trajectory, limits)
    guard.expect_force(ExpectedForce(inertia, _set_force(trajectory), limits.stiffness, alignment.drift))
    send_limits(live.links.links, guard, limits)
    check_start(live.arms.values(), trajectory, limits)
    guard.begin(live.arms)
    return check_tip_is_free(live)


def _set_force(trajectory: Trajectory) -> float:
    """Return the force [N] that a law of the motion holds."""
    return trajectory.force_law.force if isinstance(trajectory, ForceControlled) else NO_SET_FORCE


def _inertia(tip_mass: float | None, trajectory: Trajectory, limits: SafetySettings) -> float:
    """Return what acceleration adds to the force [N] at most, and the weight of a tool that turns over a surface."""
    turning = 0.0 if surface_of(trajectory) is None else GRAVITY
    return (_MAX_TIP_MASS if tip_mass is None else tip_mass) * (limits.acceleration + turning)


def move(live: LiveRun, retreat: RetreatCheck | None) -> None:
    """Let the arms follow the trajectory until they are done or the guard has tripped."""
    guard, trajectory, limits = live.guard, live.trajectory, live.rig.safety
    if retreat is not None and trajectory is not None and limits is not None:
        check_start(live.arms.values(), trajectory, limits)  # the arms have moved since
        if live.is_stopped:
            return
    guard.rise.begin_touches()
    # An error while arms move stops them, and is raised once they stand.
    try:
        for arm in live.arms.values():
            assert trajectory is not None
            arm.follow(trajectory)
        _await_end(live)
        for arrivals in live.links.after_the_end():
            live.pass_on(arrivals)
    except BaseException as error:
        guard.trip(error_text(error))
        _await_end(live)  # let the arms retract
        if guard.stop.is_stranded:
            raise guard.error from error
        raise


def _await_end(live: LiveRun) -> None:
    """Wait until the arms are done; those that are not in time after a stop are stopped where they are."""
    _await_arms(live, _PATIENCE)
    live.guard.stop.halt_late()
    _await_arms(live, _PATIENCE + _BRAKES)
    live.guard.stop.demand_rest(_PATIENCE)
    if live.interrupt.reason is not None:
        live.interrupt.reason += live.guard.stop.report_halt()


def _await_arms(live: LiveRun, patience: float) -> None:
    """Pass batches on until the arms are done, or `patience` [s] after a stop."""
    guard, interrupt = live.guard, live.interrupt
    for arrivals in live.links.to_the_end(patience):
        live.pass_on(arrivals)
        if interrupt.reason is not None:
            guard.trip(interrupt.reason)  # a signal takes note, and trips nothing
        if interrupt.asks_for_halt:
            guard.stop.halt_on_request()
