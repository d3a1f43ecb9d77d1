"""Layouts and words that the process that commands an arm and its parent agree on."""

from __future__ import annotations

from palpate import Layout

from palpate_arms.setpoint_rows import SETPOINT

STOP, RETRACT = 8, 9  # words of the ring by which the parent, from any thread, commands


class ArmRows:
    """Layouts of an arm's states, and of the rows in shared memory."""

    def __init__(self, joints: int, status: int) -> None:
        self.joints, self.status = joints, status
        parts = {"joints": joints, "joint_speeds": joints}
        parts |= {"position": 3, "rotation": 3, "velocity": 3, "turning": 3, "force": 6}
        # As the controller sends it, of the tip in the frame of the base.
        self.state = Layout(**parts)
        self.pose, self.twist = self.state.span("position", "rotation"), self.state.span("velocity", "turning")
        self.motion = self.state.span("joints", "turning")
        # A row of the ring: controller's and host's time [ns], the state, the status, the setpoint.
        self.row = Layout(controller=1, host=1, **parts, status=status, setpoint=SETPOINT.size)
