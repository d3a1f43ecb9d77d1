"""Flow of batches: as fast as they are read, or in real time."""

from __future__ import annotations

from contextlib import ExitStack

from palpate.device import Arm, is_live
from palpate.trajectory import duration_of

from palpate_engine.pipeline.approach import check_force_control
from palpate_engine.pipeline.arrivals import merge_batches, open_link
from palpate_engine.pipeline.flow import Flow
from palpate_engine.pipeline.planned_motion import check_recorded_motion, single_trajectory


def run_flow(flow: Flow) -> None:
    """Connect, set in motion, and pass every batch on until none are left."""
    if is_live(flow.rig.devices):
        from palpate_engine.pipeline.live.live_flow import run_live  # a replay loads nothing of a live run

        run_live(flow)
    else:
        _run_read(flow)


def _run_read(flow: Flow) -> None:
    """Pass on the batches of a recorded or simulated rig in the order of time, until their end or an interruption."""
    rig = flow.rig
    with ExitStack() as stack:
        links = {name: stack.enter_context(open_link(name, d, rig.run.seed)) for name, d in rig.devices.items()}
        arms = [link for link in links.values() if isinstance(link, Arm)]
        if arms:
            trajectory = single_trajectory(rig)
            flow.total = duration_of(trajectory)
            check_recorded_motion(rig, trajectory)
            for arm in arms:
                stack.callback(arm.stop)
                check_force_control(arm, trajectory)
                arm.follow(trajectory)
        else:
            durations = [d.duration for d in rig.devices.values() if d.duration is not None]
            flow.total = max(durations, default=None)
        for arrival in merge_batches(links, rig.devices):
            flow.take([arrival])
            if flow.interrupt.reason is not None:
                return
