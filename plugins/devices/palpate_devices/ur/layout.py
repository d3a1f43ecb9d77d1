"""What the servo process and its parent agree on."""

from palpate import Layout
from palpate_arms.setpoint_rows import SETPOINT

MODULE = "palpate_devices.ur.worker"
_PARTS = {"joints": 6, "joint_speeds": 6, "position": 3, "rotation": 3, "velocity": 3, "turning": 3, "force": 6}
STATE = Layout(**_PARTS)  # as the controller sends it, of the tip in the frame of the base
POSE, TWIST = STATE.span("position", "rotation"), STATE.span("velocity", "turning")
MOTION = STATE.span("joints", "turning")
# A row of the ring: controller's and host's time [ns], the state, the modes of robot, safety and program, speed slider
# and scaling, the setpoint.
ROW = Layout(controller=1, host=1, **_PARTS, modes=3, paces=2, setpoint=SETPOINT.size)
STOP, RETRACT = 8, 9  # words of the ring by which the parent, from any thread, commands
