"""Flow of batches in real time, while an arm moves."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING

from palpate.clocks import clock
from palpate.trajectory import duration_of

from palpate_engine.pipeline.live.guard import Guard
from palpate_engine.pipeline.live.links import connect_devices
from palpate_engine.pipeline.live.live_facts import LiveFacts, motion_facts
from palpate_engine.pipeline.live.live_run import LiveRun
from palpate_engine.pipeline.live.scheduling import real_time_section
from palpate_engine.pipeline.live.states import compensable_offset, get_ready, move, stand_still
from palpate_engine.pipeline.planned_motion import check_live_motion, single_trajectory
from palpate_engine.pipeline.rehearsal import refuse_rehearsal

if TYPE_CHECKING:
    from palpate_engine.pipeline.flow import Flow

_MIN_ELAPSED = 1e-9  # [s]; a run in simulated time may take none: guards against a division by 0


def run_live(flow: Flow) -> None:
    """Connect, stand still, get ready, move; until the arms are done or something stops the run.

    `flow` has the rig, the function that takes its batches, and the request to stop; it gets the facts of the run.

    Raises the guard's error where it stopped the arms and nobody else had stopped the run before, or an arm does not
    stand.
    """
    rig = flow.rig
    refuse_rehearsal(rig)
    trajectory = single_trajectory(rig) if rig.trajectories else None
    if trajectory is not None:
        check_live_motion(rig, trajectory)
    # What is refused without a device has been refused; from here on the time of the run counts.
    begin, processor_time_at_begin = clock().now(), clock().processor_time()
    guard = Guard(rig.safety, rig.ports)
    with ExitStack() as stack:
        stack.enter_context(flow.interrupt.holding_arms())
        facts = flow.facts = LiveFacts(stack.enter_context(real_time_section(flow.interrupt.stop)))
        flow.links = connect_devices(rig, stack)
        live = LiveRun(rig, flow.links, guard, trajectory, flow.take, flow.interrupt)

        def keep_motion_facts() -> None:
            facts.motion = motion_facts(flow.links, live.links.largest_backlog, guard)

        # The stack undoes this in the opposite order: the guard first, then links and arms, and the facts last. Closing
        # and stopping twice does no harm: the end of the states does so, and an error before or after it only here.
        stack.callback(keep_motion_facts)
        for arm in live.arms.values():
            stack.callback(arm.stop)
        stack.callback(live.links.stop)
        stack.callback(guard.close)
        flow.guard = guard
        flow.interrupt.trips(guard.trip)
        live.links.start()
        try:
            _pass_states(flow, live, facts)
        finally:
            guard.close()
            live.links.stop()
            for arrivals in live.links.remaining():
                live.pass_on(arrivals)
    # The time of processes that have ended is included, and so all of the devices'.
    processor_time = clock().processor_time() - processor_time_at_begin
    facts.cpu_cores = processor_time / max(clock().now() - begin, _MIN_ELAPSED)
    was_stopped_by_guard = guard.account is not None
    if was_stopped_by_guard and (flow.interrupt.reason is None or guard.stop.is_stranded):
        raise guard.error


def _pass_states(flow: Flow, live: LiveRun, facts: LiveFacts) -> None:
    """Stand still, get ready and move, until the arms are done or something stops the run."""
    facts.standstill = stand_still(live, flow.noise)
    if facts.standstill is None:
        return
    facts.offset = compensable_offset(live)
    facts.retreat = get_ready(live, facts.standstill, facts.offset)
    if live.is_stopped:
        return
    if live.arms and live.trajectory is not None:
        flow.total = duration_of(live.trajectory) + live.standstill
    move(live, facts.retreat)
